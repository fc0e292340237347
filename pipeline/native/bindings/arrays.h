// Handing a std::vector to numpy without a copy.

#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <utility>
#include <vector>

template <typename T>
nanobind::ndarray<nanobind::numpy, T> to_numpy(std::vector<T>&& values, std::initializer_list<std::size_t> shape) {
    auto* owned = new std::vector<T>(std::move(values));
    nanobind::capsule owner(owned, [](void* data) noexcept { delete static_cast<std::vector<T>*>(data); });
    return nanobind::ndarray<nanobind::numpy, T>(owned->data(), shape, owner);
}

// The same as an array object, for the field of a result.
template <typename T>
nanobind::object to_array(std::vector<T>&& values, std::initializer_list<std::size_t> shape) {
    return nanobind::cast(to_numpy(std::move(values), shape));
}

// Where a column of records begins, and how many numbers wide it is.
struct Column {
    std::size_t first, width;
};

// Columns of records, one after the other in values, as an array object each: views of the same memory.
//
// @param shape  of the records; a column wider than one number has one axis more.
template <typename T>
std::vector<nanobind::object> to_columns(std::vector<T>&& values, const std::vector<std::size_t>& shape,
                                         std::initializer_list<Column> columns) {
    auto* owned = new std::vector<T>(std::move(values));
    nanobind::capsule owner(owned, [](void* data) noexcept { delete static_cast<std::vector<T>*>(data); });
    std::size_t record = 0;
    for (const Column& column : columns) record += column.width;
    std::vector<std::int64_t> strides(shape.size(), static_cast<std::int64_t>(record));
    for (std::size_t axis = shape.size() - 1; axis-- > 0;)
        strides[axis] = strides[axis + 1] * static_cast<std::int64_t>(shape[axis + 1]);
    std::vector<nanobind::object> arrays;
    for (const Column& column : columns) {
        std::vector<std::size_t> sizes = shape;
        std::vector<std::int64_t> steps = strides;
        if (column.width > 1) {
            sizes.push_back(column.width);
            steps.push_back(1);
        }
        arrays.push_back(nanobind::cast(nanobind::ndarray<nanobind::numpy, T>(owned->data() + column.first, sizes.size(),
                                                                              sizes.data(), owner, steps.data())));
    }
    return arrays;
}
