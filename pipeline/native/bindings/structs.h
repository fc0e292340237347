// Binding plain structs: settings with one keyword a field, results with named arrays.

#pragma once

#include <nanobind/nanobind.h>

template <typename Struct, typename Value>
struct Field {
    const char* name;
    Value Struct::*member;
    const char* doc;
};

template <typename Struct, typename Value>
Field<Struct, Value> field(const char* name, Value Struct::*member, const char* doc) {
    return {name, member, doc};
}

// Settings: all fields are keywords of the constructor, so that none is left out, and can be read and written.
template <typename Struct, typename... Values>
void bind_settings(nanobind::module_& m, const char* name, const char* doc, Field<Struct, Values>... fields) {
    nanobind::class_<Struct> bound(m, name, doc);
    bound.def(
        "__init__",
        [fields...](Struct* self, Values... values) {
            new (self) Struct{};
            ((self->*(fields.member) = values), ...);
        },
        nanobind::kw_only(), nanobind::arg(fields.name)...);
    (bound.def_rw(fields.name, fields.member, fields.doc), ...);
}

// A result: its fields, arrays that own their memory, can be read, and are the same object each time.
template <typename Struct, typename... Values>
void bind_result(nanobind::module_& m, const char* name, const char* doc, Field<Struct, Values>... fields) {
    nanobind::class_<Struct> bound(m, name, doc);
    (bound.def_ro(fields.name, fields.member, fields.doc), ...);
}
