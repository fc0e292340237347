"""A look that is being made: edits of an asset's leaves in the session layer, where usdview saves overrides from."""

from pathlib import Path

from pxr import Gf, Sdf, Usd

from usdviewFoliage import plants
from usdviewFoliage.look_layer import (
    BEZIER,
    EDITS,
    LOD,
    REPRESENTATION,
    author_edits,
    build_look,
    find_class,
    leafy_lods,
    path_between,
    select_lod,
    widen_extents,
)
from usdviewFoliage.reach import box_among_leaves, box_in_leaf_space, read_range


class LiveLook:
    """Edits of all plants of one asset on a stage, as opinions of the session layer on the class of the asset."""

    def __init__(self, stage: Usd.Stage, plant: Usd.Prim) -> None:
        """Edit the asset of plant; nothing is authored yet."""
        self.stage = stage
        self.plant_path = plant.GetPath()
        self.interface = plants.interface_file(plant)
        self.class_path = find_class(plant)
        self.layer = Sdf.Layer.CreateAnonymous(f"{plant.GetName()}_look.usda")  # the edits, also while they are hidden
        self._visible = True
        self._ranges = {}
        if self.class_path is not None and stage.GetSessionLayer().GetPrimAtPath(self.class_path):
            _copy_prim(stage.GetSessionLayer(), self.class_path, self.layer)  # of an earlier panel on this stage
        # The asset without this look, to compare with: the same layers, opened once.
        beside = Sdf.Layer.CreateAnonymous()
        mask = Usd.StagePopulationMask([self.plant_path])
        self._base = Usd.Stage.OpenMasked(stage.GetRootLayer(), beside, mask)
        self._base.SetEditTarget(beside)
        for prefix in self.plant_path.GetPrefixes():
            if self._base.GetPrimAtPath(prefix).IsInstance():  # in one no variant can be selected
                self._base.GetPrimAtPath(prefix).SetInstanceable(False)
        sets = self.base_plant.GetVariantSets()
        if BEZIER in sets.GetVariantSet(REPRESENTATION).GetVariantNames():
            sets.SetSelection(REPRESENTATION, BEZIER)
        for lod in leafy_lods(self.base_plant)[:1]:
            select_lod(self.base_plant, lod)

    @property
    def plant(self) -> Usd.Prim:
        return self.stage.GetPrimAtPath(self.plant_path)

    @property
    def base_plant(self) -> Usd.Prim:
        return self._base.GetPrimAtPath(self.plant_path)

    def why_not(self) -> str:
        """Why the leaves cannot be edited now; empty where they can."""
        if self.class_path is None:
            return "This plant inherits no class, so no look can reach it."
        if not self.plant:
            return "This plant is gone from the stage."
        if not plants.find_leaves(self.base_plant):
            return "This plant has no leaves that can be edited."
        if not plants.find_leaves(self.plant):
            sets = plants.variants(self.plant)
            lod, leafy = sets.get(LOD, ([], ""))[1], leafy_lods(self.plant)
            if leafy and lod not in leafy:
                return f"The lod {lod} shows no leaves to edit: choose {' or '.join(leafy)}."
            if sets.get(REPRESENTATION, ([], ""))[1] not in ("", BEZIER):
                return f"Edits act on the representation {BEZIER}: choose it."
            return "No leaves are shown that can be edited."
        return ""

    def values(self) -> dict:
        """The edits as the leaves have them now."""
        return _read(plants.find_leaves(self.plant)[0])

    def apply(self, edits: dict, bounds: list | None = None) -> None:
        """Give the leaves these edits: only what differs from the asset is authored, with the extents that it needs.

        Args:
            bounds: What holds the edited leaves of each prim (Product.leaf_bounds); without, a wider guess.
        """
        self.layer.TransferContent(self._build(edits, "", bounds))
        self._publish()

    def reset(self) -> None:
        """Take all edits back."""
        self.layer.Clear()
        self._publish()

    def is_visible(self) -> bool:
        return self._visible

    def is_edited(self) -> bool:
        """Whether the leaves differ from the asset's."""
        return bool(self.layer.rootPrims)

    def show(self, visible: bool) -> None:
        """Hide the edits, or show them again."""
        self._visible = visible
        self._publish()

    def _publish(self) -> None:
        """Make the session layer's opinions on the class those of the look, or none where they are hidden."""
        if self.class_path is None:
            return
        session = self.stage.GetSessionLayer()
        wanted = Sdf.Layer.CreateAnonymous()
        wanted.TransferContent(session)
        if wanted.GetPrimAtPath(self.class_path):
            _remove_prim(wanted, self.class_path)
        if self._visible and self.layer.GetPrimAtPath(self.class_path):
            _copy_prim(self.layer, self.class_path, wanted)
        session.TransferContent(wanted)  # notifies the stage only of what differs

    def write(self, path: str, edits: dict) -> None:
        """Write the edits as a look, with no more than USD; its extents are wider than those of usdfoliage."""
        if not path.endswith(".usda"):
            raise ValueError(f"{path}: the name of a look ends with .usda")
        layer = self._build(edits, path_between(self.interface, str(Path(path).absolute().parent)))
        if not layer.Export(path):
            raise ValueError(f"{path} cannot be written")
        opened = Sdf.Layer.Find(path)
        if opened:
            opened.Reload(force=True)

    def _build(self, edits: dict, look_of: str, bounds: list | None = None) -> Sdf.Layer:
        self._follow()
        plant = self.base_plant

        def author_leaves(stage: Usd.Stage) -> None:
            for number, prim in enumerate(plants.find_leaves(plant)):
                at = prim.GetPath().ReplacePrefix(self.plant_path, self.class_path)
                author_edits(stage, at, edits, _read(prim))
                known = None if bounds else self._range(prim)
                if bounds:
                    box, among = (Gf.Range3d(*map(Gf.Vec3d, bounds[number][name])) for name in ("leaf", "among"))
                elif known is not None:
                    box = box_in_leaf_space(known, edits)
                    among = box_among_leaves(known, box)
                else:  # no leaves
                    continue
                widen_extents(stage, self.class_path, plant, prim, box, among)

        return build_look(plant, self.class_path, look_of, author_leaves)

    def _follow(self) -> None:
        """Mute what the shown stage mutes."""
        wanted = set(self.stage.GetMutedLayers())
        muted = set(self._base.GetMutedLayers())
        if wanted != muted:
            self._base.MuteAndUnmuteLayers(sorted(wanted - muted), sorted(muted - wanted))

    def _range(self, prim: Usd.Prim):
        path = prim.GetPath()
        if path not in self._ranges:
            self._ranges[path] = read_range(prim)
        return self._ranges[path]


def _copy_prim(source: Sdf.Layer, path: Sdf.Path, target: Sdf.Layer) -> None:
    """Copy a prim with all below it; what stands above it becomes overs."""
    Sdf.CreatePrimInLayer(target, path)
    Sdf.CopySpec(source, path, target, path)


def _remove_prim(layer: Sdf.Layer, path: Sdf.Path) -> None:
    """Remove a prim, and overs above it that hold nothing else."""
    while path != Sdf.Path.absoluteRootPath:
        edit = Sdf.BatchNamespaceEdit()
        edit.Add(path, Sdf.Path.emptyPath)
        layer.Apply(edit)
        path = path.GetParentPath()
        above = layer.GetPrimAtPath(path)
        if above is None or path == Sdf.Path.absoluteRootPath or above.nameChildren or above.properties:
            return
        if set(above.ListInfoKeys()) - {"specifier"} or above.specifier != Sdf.SpecifierOver:
            return


_SINGLE = ("width", "jitter_amplitude", "jitter_frequency")  # edits of one number; the others have three


def _read(prim: Usd.Prim) -> dict:
    """The edits of leaves that are authored; one of another type, which a broken layer may hold, is as none."""
    edits = {}
    for name, primvar in EDITS.items():
        attribute = prim.GetAttribute(f"primvars:{primvar}")
        value = attribute.Get(Usd.TimeCode.EarliestTime()) if attribute else None
        if name in _SINGLE and isinstance(value, (int, float)):
            edits[name] = float(value)
        elif name not in _SINGLE and isinstance(value, (Gf.Vec3f, Gf.Vec3d, Gf.Vec3h)):
            edits[name] = tuple(map(float, value))
    return edits
