"""Settings of native kernels, filled from the dataclasses that hold them in Python."""

from typing import TypeVar

Native = TypeVar("Native")


def native_settings(kind: type[Native], settings: object = None, /, **values: object) -> Native:
    """Settings of a native kernel: each of its fields is a field of the same name of a dataclass, or one of the values.

    Args:
        kind: A settings class of usdfoliage._native.
        settings: A dataclass; fields that the kernel does not have are left out.
        values: Fields that the dataclass does not have, or has in another unit. They go before its own.

    Raises:
        TypeError: A field of the kernel is in neither, or a value is of no field.
    """
    names = [name for name, member in vars(kind).items() if isinstance(member, property)]
    missing = [name for name in names if name not in values and not hasattr(settings, name)]
    if missing:
        raise TypeError(f"{kind.__name__} needs {', '.join(missing)}, which {type(settings).__name__} does not have")
    return kind(**{name: getattr(settings, name) for name in names if name not in values}, **values)
