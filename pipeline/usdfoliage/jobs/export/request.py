"""What an export is asked for, and what will be written, known before anything is made."""

from dataclasses import dataclass
from pathlib import Path

from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.export.source import ExportSource, check_exportable, check_output_place
from usdfoliage.asset.locate import USD_SUFFIXES
from usdfoliage.asset.look_layer import LEAFY_LODS
from usdfoliage.asset.plant import asset_name
from usdfoliage.errors import AssetError, FoliageError

PROFILES = ("standalone", "usdz", "unreal")
STANDALONE, USDZ, UNREAL = PROFILES
LODS = ("leaves", "crown")
LEAF_FORMS = ("mesh", "instances")
MAX_SHAPES = 4096
SIDES = (1, 2)


@dataclass(frozen=True, kw_only=True)
class ExportSettings:
    """What of an asset is exported, and how fine."""

    lod: str | None = None  # one of LODS; None: leaves where the asset has them
    leaves: str = "mesh"  # one of LEAF_FORMS: one mesh of all leaves, or a few shapes that repeat
    shapes: int = 64  # at most so many shapes of leaves, where they repeat
    sides: int | None = None  # faces of a leaf: 1 for both sides, or 2, one a side; None: 2 in a package
    max_cage_faces: int = 500_000  # of a subdivision surface that is refined

    def __post_init__(self) -> None:
        if self.lod is not None and self.lod not in LODS:
            raise ValueError(f"lod must be one of {', '.join(LODS)}, not {self.lod}")
        if self.leaves not in LEAF_FORMS:
            raise ValueError(f"leaves must be one of {', '.join(LEAF_FORMS)}, not {self.leaves}")
        if not 1 <= self.shapes <= MAX_SHAPES:
            raise ValueError(f"shapes must be 1 to {MAX_SHAPES}, not {self.shapes}")
        if self.sides is not None and self.sides not in SIDES:
            raise ValueError(f"sides must be {' or '.join(map(str, SIDES))}, not {self.sides}")


@dataclass(frozen=True, kw_only=True)
class ExportRequest:
    """What the user asked for, checked."""

    asset: Path
    output: Path
    profile: str  # one of PROFILES
    name: str | None = None
    resolution: tuple[int, int] | None = None  # of each leaf
    settings: ExportSettings = ExportSettings()
    force: bool = False
    keep_old: bool = False

    @property
    def is_package(self) -> bool:
        return self.profile == USDZ

    @property
    def repeats_leaves(self) -> bool:
        """Whether leaves repeat a few shapes."""
        return self.profile == UNREAL or self.settings.leaves == "instances"

    @property
    def has_both_sides(self) -> bool:
        """Whether each side of a leaf has its own faces."""
        return self.settings.sides == 2 or (self.settings.sides is None and self.is_package)


@dataclass(frozen=True, kw_only=True)
class ExportPlan:
    """What will be exported."""

    source: ExportSource
    lod: str  # empty where the asset has but one form
    name: str
    file: str  # the USD file, from the output
    origin: AssetOrigin

    @property
    def has_leaves(self) -> bool:
        return self.source.has_leaves and self.lod != "crown"


def plan_output(request: ExportRequest, version: str) -> ExportPlan:
    """Check a request against the asset.

    Raises:
        FoliageError: The asset is none that can be exported so, or the output is in a place where it may not be.
    """
    source = check_exportable(request.asset, version)
    check_output_place(request.output, source.interface)
    _check_output_name(request)
    if request.has_both_sides and request.repeats_leaves:
        raise FoliageError("leaves that repeat have one face for both sides", "export the leaves as mesh, or one side")
    name = asset_name(request.name or (request.output.stem if request.is_package else request.output.resolve().name))
    lod = _choose_lod(request, source)
    if request.profile == UNREAL and not (source.has_leaves and lod != "crown"):
        raise AssetError(
            f"{request.asset} is exported without leaves, which are the parts of an assembly of Unreal",
            "export it with the profile standalone",
        )
    return ExportPlan(
        source=source,
        lod=lod,
        name=name,
        file=request.output.name if request.is_package else f"{name}.usdc",
        origin=AssetOrigin(name=name, command="export", source=source.interface.stem),
    )


def _check_output_name(request: ExportRequest) -> None:
    suffix = request.output.suffix.lower()
    if not request.is_package:
        if suffix in USD_SUFFIXES:
            raise AssetError(f"{request.output} is the name of a file", "name a folder for the export")
        return
    if suffix != ".usdz":
        raise AssetError(f"{request.output} cannot be a package: its name must end with .usdz")
    if request.keep_old:
        raise FoliageError("an old package is not kept, since it is one file", "name another file")
    if request.settings.leaves == "instances":
        raise FoliageError("AR shows no instances, so a package has none", "export the leaves as mesh")


def _choose_lod(request: ExportRequest, source: ExportSource) -> str:
    wanted, lods = request.settings.lod, source.lods
    leafy = next((lod for lod in LEAFY_LODS if lod in lods), "")
    if not lods:
        return ""
    chosen = {"leaves": leafy, "crown": "crown", None: leafy or "crown"}[wanted]
    if chosen not in lods:
        raise AssetError(f"{request.asset} has no {wanted}; its lods are {', '.join(lods)}", "choose another lod")
    return chosen
