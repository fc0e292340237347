// usdfoliage._native: the kernels that are hot or need OpenSubdiv. Each bind_*.cpp adds one header's functions.

#include <nanobind/nanobind.h>

#include "bindings/bindings.h"

NB_MODULE(_native, m) {
    m.doc() = "Native kernels of usdfoliage; arrays in, arrays out, the interpreter lock released.";
    bind_subdivision(m);
    bind_radius_map(m);
    bind_grid_cut(m);
    bind_texture_synthesis(m);
    bind_leaf(m);
    bind_leaf_raster(m);
    bind_enclosing_ellipse(m);
    bind_leaf_fit(m);
    bind_leaf_closest(m);
    bind_leaf_surface_fit(m);
    bind_dense_segmentation(m);
    bind_leaf_samples(m);
    bind_lobed(m);
    bind_pinhole(m);
    bind_patch_match(m);
    bind_branch_cage(m);
    bind_tubes(m);
    bind_piece_bridges(m);
    bind_piece_gaps(m);
    bind_polylines(m);
    bind_merge_regions(m);
    bind_crown_answers(m);
    bind_crown_choice(m);
}
