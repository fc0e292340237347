"""The rez package: `rez-build --install` makes it, `rez-env usdfoliage` sets what `usdfoliage env` prints.

The required packages have the names that `rez pip --install` gives them.
"""

name = "usdfoliage"

version = "0.1.0"

description = "Photographs of real plants in, editable OpenUSD foliage assets out."

tools = ["usdfoliage"]

requires = [
    "usd_core-26.11+",
    "numpy-2+",
    "scipy",
    "OpenImageIO-3+",
    "OpenEXR-3.3+",
    "opencv_contrib_python_headless-4.11+",
    "Jinja2",
    "laspy-2.7+",
    "lazrs",
    "tqdm",
    "PyYAML",
    "pycolmap",
    "rawpy-0.25+",
    "pye57-0.4.15+",
    "rasterio-1.4+",
]

private_build_requires = ["scikit_build_core-1+", "nanobind-3+", "cmake", "ninja"]

variants = [["python-3.11"], ["python-3.12"], ["python-3.13"]]

build_command = (
    'if [ "$REZ_BUILD_INSTALL" = 1 ]; then '
    "python -m pip install --no-deps --no-build-isolation --upgrade "
    '--target "$REZ_BUILD_INSTALL_PATH/python" "$REZ_BUILD_SOURCE_PATH"; fi'
)


def commands():
    env.PATH.prepend("{root}/python/bin")  # noqa: F821  rez provides env
    env.PYTHONPATH.prepend("{root}/python")  # noqa: F821
    env.PYTHONPATH.prepend("{root}/python/usdfoliage/share/usd_plugins")  # noqa: F821
    env.PXR_PLUGINPATH_NAME.prepend("{root}/python/usdfoliage/share/usd_plugins/usdviewFoliage")  # noqa: F821
    env.PXR_PLUGINPATH_NAME.prepend("{root}/python/usdfoliage/share/usd_plugins/usdFoliageValidators")  # noqa: F821
    env.PXR_PLUGINPATH_NAME.prepend("{root}/python/usdfoliage/share/schemas/usdFoliage")  # noqa: F821
