// The extension's one threading mechanism.

#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

// Call fn(i) for i in [0, n) from at most `threads` threads (0: one per core), in any order.
//
// fn must write only what belongs to its own i and must not throw, so that the result is the same for any number of
// threads.
template <typename Fn>
void parallel_for(std::size_t n, int threads, const Fn& fn) {
    const std::size_t cores = threads > 0 ? static_cast<std::size_t>(threads) : std::max(1u, std::thread::hardware_concurrency());
    const std::size_t workers = std::min(cores, n);
    std::atomic<std::size_t> next{0};
    const auto work = [&] {
        for (std::size_t i = next++; i < n; i = next++) fn(i);
    };
    std::vector<std::thread> others;
    for (std::size_t k = 1; k < workers; ++k) others.emplace_back(work);
    work();
    for (std::thread& other : others) other.join();
}

// The same for many small calls: so many of them one after another are one task.
template <typename Fn>
void parallel_blocks(std::size_t n, std::size_t block, int threads, const Fn& fn) {
    parallel_for((n + block - 1) / block, threads, [&](std::size_t task) {
        for (std::size_t i = task * block; i < std::min(n, (task + 1) * block); ++i) fn(i);
    });
}
