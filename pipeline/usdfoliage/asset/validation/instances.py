"""The prims of a stage with those that instances show, each prototype of USD once."""

from collections.abc import Iterator

from pxr import Usd


def iterate_prims(stage: Usd.Stage, predicate: object = Usd.PrimDefaultPredicate) -> Iterator[Usd.Prim]:
    """Every prim that satisfies the predicate, in the stage's order.

    Of the instances that share a prototype only the first is entered: the others show the same. What is in it comes as
    instance proxies, whose paths are those of the scene.
    """
    seen: set[Usd.Prim] = set()
    walk = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(predicate)))
    for prim in walk:
        yield prim
        if not prim.IsInstance():
            continue
        prototype = prim.GetPrototype()
        if prototype in seen:
            walk.PruneChildren()
        seen.add(prototype)
