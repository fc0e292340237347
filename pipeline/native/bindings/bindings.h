// One entry per bind_*.cpp, called once by module.cpp.

#pragma once

#include <nanobind/nanobind.h>

void bind_subdivision(nanobind::module_& m);
void bind_radius_map(nanobind::module_& m);
void bind_grid_cut(nanobind::module_& m);
void bind_texture_synthesis(nanobind::module_& m);
void bind_leaf(nanobind::module_& m);
void bind_leaf_raster(nanobind::module_& m);
void bind_enclosing_ellipse(nanobind::module_& m);
void bind_leaf_fit(nanobind::module_& m);
void bind_leaf_closest(nanobind::module_& m);
void bind_leaf_surface_fit(nanobind::module_& m);
void bind_dense_segmentation(nanobind::module_& m);
void bind_leaf_samples(nanobind::module_& m);
void bind_lobed(nanobind::module_& m);
void bind_pinhole(nanobind::module_& m);
void bind_patch_match(nanobind::module_& m);
void bind_branch_cage(nanobind::module_& m);
void bind_tubes(nanobind::module_& m);
void bind_piece_bridges(nanobind::module_& m);
void bind_piece_gaps(nanobind::module_& m);
void bind_polylines(nanobind::module_& m);
void bind_merge_regions(nanobind::module_& m);
void bind_crown_answers(nanobind::module_& m);
void bind_crown_choice(nanobind::module_& m);
