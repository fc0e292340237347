"""Qt as the program has it: that of usdview, else PySide6."""

import importlib.util

if importlib.util.find_spec("pxr.Usdviewq") is not None:
    from pxr.Usdviewq.qt import QtCore, QtGui, QtWidgets
else:
    from PySide6 import QtCore, QtGui, QtWidgets

__all__ = ["QtCore", "QtGui", "QtWidgets"]
