// Loops compiled for wide vectors where the processor has them.
//
// A function marked so is compiled for AVX2 and for any processor, with everything it calls; which is run is chosen when
// the extension is loaded. Both give the same bits: no fused multiply-add (-ffp-contract=off) and no sums in another order,
// so that a loop may only have sums of its own for each place of a vector.

#pragma once

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__)
#define USDFOLIAGE_VECTOR_CLONES __attribute__((target_clones("avx2", "default"), flatten))
#else
#define USDFOLIAGE_VECTOR_CLONES
#endif
