"""How a look is made up: the module of usdfoliage that builds it, loaded by itself.

The rest of usdfoliage stays out of the program, whose Python may be another one.
"""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

_FOLDER = Path(__file__).resolve().parent
# In a source checkout, and in an installed package, whose share/ this is in.
_PLACES = (_FOLDER.parents[1] / "pipeline" / "usdfoliage", _FOLDER.parents[2])


def _load() -> ModuleType:
    name = "usdviewFoliage._usdfoliage_look_layer"
    for place in _PLACES:
        file = place / "asset" / "look_layer.py"
        if not file.is_file():
            continue
        specification = importlib.util.spec_from_file_location(name, file)
        module = importlib.util.module_from_spec(specification)
        sys.modules[name] = module
        specification.loader.exec_module(module)
        return module
    raise ImportError(
        f"usdfoliage/asset/look_layer.py is missing, looked for in {' and '.join(map(str, _PLACES))}; "
        "leave usd_plugins where usdfoliage was installed"
    )


_module = _load()
EDITS = _module.EDITS
REPRESENTATION = _module.REPRESENTATION
BEZIER = _module.BEZIER
LOD = _module.LOD
author_edits = _module.author_edits
build_look = _module.build_look
find_class = _module.find_class
leafy_lods = _module.leafy_lods
select_lod = _module.select_lod
path_between = _module.path_between
widen_extents = _module.widen_extents
