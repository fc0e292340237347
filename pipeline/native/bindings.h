// One entry per bind_*.cpp, called once by module.cpp.

#pragma once

#include <nanobind/nanobind.h>

void bind_subdivision(nanobind::module_& m);
