"""Walking a stage with what its instances show."""

import usdfoliage  # noqa: F401  registers the schemas, before any stage
from pxr import Usd, UsdGeom
from usdfoliage.asset.validation.instances import iterate_prims


def nested() -> Usd.Stage:
    """Two instances of a group that has two instances of a leaf."""
    stage = Usd.Stage.CreateInMemory()
    stage.CreateClassPrim("/leaf")
    UsdGeom.Xform.Define(stage, "/leaf/blade")
    stage.CreateClassPrim("/twig")
    for path, source in (("/twig/a", "/leaf"), ("/twig/b", "/leaf"), ("/one", "/twig"), ("/two", "/twig")):
        prim = UsdGeom.Xform.Define(stage, path).GetPrim()
        prim.GetReferences().AddInternalReference(source)
        prim.SetInstanceable(True)
    return stage


def test_of_equal_instances_one_is_entered() -> None:
    paths = [str(prim.GetPath()) for prim in iterate_prims(nested())]
    assert paths == ["/one", "/one/a", "/one/a/blade", "/one/b", "/two"]


def test_instances_that_differ_are_entered_each() -> None:
    stage = nested()
    stage.CreateClassPrim("/bud")
    UsdGeom.Xform.Define(stage, "/bud/more")
    stage.GetPrimAtPath("/two").GetReferences().AddInternalReference("/bud")
    paths = [str(prim.GetPath()) for prim in iterate_prims(stage)]
    assert sorted(paths) == ["/one", "/one/a", "/one/a/blade", "/one/b", "/two", "/two/a", "/two/b", "/two/more"]


def test_predicate() -> None:
    stage = nested()
    stage.GetPrimAtPath("/one").SetActive(False)
    assert [str(prim.GetPath()) for prim in iterate_prims(stage, Usd.PrimIsActive)][:2] == ["/leaf", "/leaf/blade"]
    assert "/two/a/blade" in [str(prim.GetPath()) for prim in iterate_prims(stage)]
