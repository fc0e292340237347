"""Containers of commands, the registry that they fill, and the menus that they build."""

import importlib

from pxr import Tf


class Deferred:
    """A module whose functions import it when the first one is called."""

    def __init__(self, name, package):
        self._name, self._package = name, package

    def __getattr__(self, function):
        def call(*arguments):
            return getattr(importlib.import_module(self._name, self._package), function)(*arguments)

        return call


class PluginContainer:
    def deferredImport(self, moduleName):
        return Deferred(moduleName, self.__module__)

    def registerPlugins(self, plugRegistry, plugCtx):
        raise NotImplementedError

    def configureView(self, plugRegistry, plugUIBuilder):
        raise NotImplementedError


PluginContainerTfType = Tf.Type.Define(PluginContainer)


class Command:
    def __init__(self, name, displayName, callback, description, api):
        self.name, self.displayName, self.description = name, displayName, description
        self._callback, self._api = callback, api

    def run(self):
        self._callback(self._api)


class Registry:
    def __init__(self, api):
        self._api = api
        self.commands = {}

    def registerCommandPlugin(self, name, displayName, callback, description=""):
        if name in self.commands:
            raise ValueError(f"{name} is registered twice")
        self.commands[name] = Command(name, displayName, callback, description, self._api)
        return self.commands[name]


class Menu:
    def __init__(self, menu):
        self._menu = menu
        self._submenus = {}

    def addItem(self, commandPlugin, shortcut=None):
        action = self._menu.addAction(commandPlugin.displayName, lambda: commandPlugin.run())
        action.setToolTip(commandPlugin.description)
        return action

    def findOrCreateSubmenu(self, menuName):
        if menuName not in self._submenus:
            self._submenus[menuName] = Menu(self._menu.addMenu(menuName))
        return self._submenus[menuName]

    def addSeparator(self):
        self._menu.addSeparator()


class UIBuilder:
    def __init__(self, window):
        self._window = window
        self._menus = {}

    def findOrCreateMenu(self, menuName):
        if menuName not in self._menus:
            self._menus[menuName] = Menu(self._window.menuBar().addMenu(menuName))
        return self._menus[menuName]
