"""A user's settings of a build: those of every stage, one table each."""

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from usdfoliage.errors import FoliageError
from usdfoliage.isolation.pieces import PieceSettings
from usdfoliage.jobs.branches.foliage import FoliageRequest
from usdfoliage.jobs.branches.regrowth import MAX_SPREAD, MAX_VARIATIONS, METHODS, TRACE, Fill, Method, RegrowthRequest
from usdfoliage.jobs.capture.settings import CaptureRunSettings
from usdfoliage.jobs.edits.scatter import LENGTHS_M, MAX_LEAVES
from usdfoliage.jobs.leaves.settings import LeavesSettings
from usdfoliage.jobs.plant.pages.pictures import PictureSettings
from usdfoliage.jobs.plant.plant_settings import PlantSettings, SeedSettings
from usdfoliage.jobs.plant_cloud import PlantCloudRequest, read_roots
from usdfoliage.jobs.sketch.model import MAX_LEAF_LENGTH_M, SketchModelSettings
from usdfoliage.jobs.sketch.model import MAX_LEAVES as MAX_SKETCH_LEAVES
from usdfoliage.jobs.work.settings_file import set_everywhere
from usdfoliage.sketch.growth import SketchGrowthSettings
from usdfoliage.sketch.reconstruct import SketchSettings
from usdfoliage.sketch.strokes import MAX_TREES

LeafDepth = Literal["auto", "given", "estimated"]
FoliageKind = Literal["auto", "captured", "filled", "drawn", "species", "none"]
MakeBranches = Literal["auto", "on", "off"]
MakeIsolation = Literal["auto", "off"]
MakeSketchLeaves = Literal["auto", "on", "off"]
CloudLeaves = Literal["auto", "on", "off"]

STAGE_SETTINGS = (
    "plant",
    "capture",
    "isolation",
    "branches",
    "leaves",
    "foliage",
    "crown",
    "pictures",
)  # tables that decide a result of a capture or a cloud
SKETCH_SETTINGS = ("plant", "sketch", "pictures")  # those that decide one of a single photograph


@dataclass(frozen=True, kw_only=True)
class IsolationStageSettings:
    """How the plant is separated from what is around it; what is left out is in no mask, and in no cloud."""

    # auto separates the plant from its surroundings; off takes everything in the photographs for the plant.
    make: MakeIsolation = "auto"
    floor: bool = True  # true leaves out the floor under the plant, where it is nearly level and clearly seen.
    container: bool = True  # true leaves out the pot, where the plant is green and the pot is not.
    # true leaves out everything that is not linked with the plant, where the photographs are aimed at one place.
    outliers: bool = True
    # Half the thickness of a floor is this share of the distance from the cameras to the plant. Range: 0.001 to 0.1.
    floor_layer: float = 0.012
    # Parts of the plant are linked across gaps of up to this share of the distance from the cameras to the plant.
    # Range: 0.03 to 1.
    link_gap: float = 0.1

    def __post_init__(self) -> None:
        if self.make not in get_args(MakeIsolation):
            raise ValueError(f"make must be one of {', '.join(get_args(MakeIsolation))}, not {self.make!r}")
        if not 0.001 <= self.floor_layer <= 0.1:
            raise ValueError(f"floor_layer must be 0.001 to 0.1, not {self.floor_layer:g}")
        if not PieceSettings.gap <= self.link_gap <= 1:
            raise ValueError(
                f"link_gap must be {PieceSettings.gap:g} to 1, not {self.link_gap:g}: what is nearer is one piece"
            )


@dataclass(frozen=True, kw_only=True)
class BranchStageSettings:
    """How branches are traced through the cloud."""

    # trace: branches follow the points of the cloud; grow: they grow from the roots through the points.
    method: Method = TRACE
    # on lets branches grow on into what they leave of the cloud; auto does so where branches are traced and leave more
    # than 3 % of a cloud without photographs that does not show which of its points are leaves.
    fill: Fill = "auto"
    # auto traces branches where the cloud shows stems or branches, or its points are too far apart to show leaves, and
    # refuses a cloud without photographs that looks like a building, a wall, bare ground or a hedge; on traces them in
    # any case; off traces none.
    make: MakeBranches = "auto"
    roots: str = "auto"  # Stems leave the ground here: auto, a number of stems, or x,y,z in the capture's coordinates.
    # An internode has this length; auto is 0.005 of the plant's height. Unit: metres. Range: above 0.
    internode_m: float | None = None
    # on: the cloud has leaves, which tracing leaves out; off: it has none; auto decides by the cloud.
    cloud_leaves: CloudLeaves = "auto"
    # true traces stems that are lines in the photographs, where the cloud shows few round branches, as of a herb.
    photographs: bool = True
    # Branches are traced through this many points of the cloud at most. Range: 50 or more.
    max_points: int = PlantCloudRequest.max_points
    # The surface of the branches has this many faces at most; auto is 6 for each point of the cloud, from 30000 to
    # 400000. Range: 1000 or more.
    max_faces: int | None = None
    # This many further plants like this one grow: assets in the folder variations of the asset. Range: 0 to 99.
    variations: int = 0
    # Variations differ in height, crown, limbs and stem by this factor of what trees of one kind and age differ by.
    # With 0 they keep the outline of the plant. Range: 0 to 2.
    variation_spread: float = RegrowthRequest.variation_spread

    def __post_init__(self) -> None:
        if self.internode_m is not None and not self.internode_m > 0:
            raise ValueError(f"internode_m must be above 0, not {self.internode_m:g}")
        if self.make not in get_args(MakeBranches):
            raise ValueError(f"make must be one of {', '.join(get_args(MakeBranches))}, not {self.make!r}")
        if self.method not in METHODS:
            raise ValueError(f"method must be one of {', '.join(METHODS)}, not {self.method!r}")
        if self.fill not in get_args(Fill):
            raise ValueError(f"fill must be one of {', '.join(get_args(Fill))}, not {self.fill!r}")
        if self.cloud_leaves not in get_args(CloudLeaves):
            raise ValueError(f"cloud_leaves must be one of {', '.join(get_args(CloudLeaves))}, not {self.cloud_leaves}")
        if self.max_points < 50:
            raise ValueError(f"max_points must be at least 50, not {self.max_points}")
        if not 0 <= self.variations <= MAX_VARIATIONS:
            raise ValueError(f"variations must be 0 to {MAX_VARIATIONS}, not {self.variations}")
        if not 0 <= self.variation_spread <= MAX_SPREAD:
            raise ValueError(f"variation_spread must be 0 to {MAX_SPREAD:g}, not {self.variation_spread:g}")
        if self.variations and self.make == "off":
            raise ValueError("variations need branches, and make is off: set make to auto, or variations to 0")
        if self.max_faces is not None and self.max_faces < 1000:
            raise ValueError(f"max_faces must be at least 1000, not {self.max_faces}")
        try:
            read_roots(self.roots)
        except FoliageError as error:
            raise ValueError(str(error)) from error


@dataclass(frozen=True, kw_only=True)
class LeafStageSettings(LeavesSettings):
    """How single leaves are found in the photographs, or in a cloud alone."""

    make: bool = True  # true searches single leaves in the photographs, or in a cloud alone.
    # given uses the maps of the capture's folder depth/; estimated uses those of the stage capture; auto uses given
    # maps where there are any.
    depth: LeafDepth = "auto"
    # A cloud alone gives its own leaves where at least this many of those that are found are right, by the sum of their
    # confidences. Range: 0 or more.
    min_in_cloud: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.min_in_cloud >= 0:
            raise ValueError(f"min_in_cloud must be 0 or more, not {self.min_in_cloud:g}")


@dataclass(frozen=True, kw_only=True)
class FoliageSettings:
    """Which leaves the plant has."""

    # captured keeps the leaves that were found; filled adds others like them wherever the cloud has more leaves;
    # drawn puts leaves drawn from the found ones on the twigs; species puts leaves of the species on the twigs. auto
    # takes captured where they cover the plant, else filled where leaves are recognised in the cloud, else drawn or
    # species. Where few leaves were found and stems are of photographs, auto takes captured.
    kind: FoliageKind = "auto"
    # auto adds no leaves where the captured ones cover at least this share of the cloud's leaves. Range: 0 to 1.
    min_cover: float = 0.85
    min_drawn: int = 20  # auto draws from the captured leaves where there are at least this many. Range: 1 or more.
    # A leaf on a twig has this length; auto takes that of the species, or of the captured leaves. Unit: metres.
    # Range: 1e-06 to 1000.
    leaf_length_m: float | None = None
    # The twigs get at most this many leaves. Range: 1 to 10000000.
    max_leaves: int = FoliageRequest().settings.max_leaves

    def __post_init__(self) -> None:
        if self.kind not in get_args(FoliageKind):
            raise ValueError(f"kind must be one of {', '.join(get_args(FoliageKind))}, not {self.kind!r}")
        if not 0 <= self.min_cover <= 1:
            raise ValueError(f"min_cover must be 0 to 1, not {self.min_cover:g}")
        shortest_m, longest_m = LENGTHS_M
        if self.leaf_length_m is not None and not shortest_m <= self.leaf_length_m <= longest_m:
            raise ValueError(f"leaf_length_m must be {shortest_m:g} to {longest_m:g}, not {self.leaf_length_m:g}")
        if not 1 <= self.max_leaves <= MAX_LEAVES:
            raise ValueError(f"max_leaves must be 1 to {MAX_LEAVES}, not {self.max_leaves}")
        if self.min_drawn < 1:
            raise ValueError(f"min_drawn must be at least 1, not {self.min_drawn}")


@dataclass(frozen=True, kw_only=True)
class CrownStageSettings:
    """How the crown is made of the cloud and of photographs, if any."""

    make: bool = True  # true gives the plant a crown.
    size: int = 256  # A face of the crown's cubemaps has this many texels a side. Unit: texels. Range: 32 to 4096.
    # The crown's cage has this many vertices along an edge of the cube; auto takes as few as keep its silhouettes.
    # Range: 3 to 4097.
    mesh_size: int | None = None

    def __post_init__(self) -> None:
        if not 32 <= self.size <= 4096:
            raise ValueError(f"size must be 32 to 4096 texels, not {self.size}")
        if self.mesh_size is not None and not 3 <= self.mesh_size <= 4097:
            raise ValueError(f"mesh_size must be 3 to 4097, not {self.mesh_size}")


@dataclass(frozen=True, kw_only=True)
class SketchStageSettings:
    """How a tree is made of one photograph and the strokes over it; the tables plant and pictures hold for it too."""

    # Of several trees in the strokes this one is made, counted from 1; auto is the only one. Range: 1 to 100.
    tree: int | None = None
    # The tree has this height from its root to its top. Unit: metres. Range: above 0.
    height_m: float = SketchSettings.height_m
    depth: float = SketchSettings.depth  # The crown is deeper than it is wide by this factor. Range: 0.1 to 5.
    # Branches that the photograph does not show hang at 1 and rise at -1. Range: -1 to 1.
    gravity: float = SketchGrowthSettings.gravity
    # The tree has so many times the leaves that its species has and the photograph shows. Range: 0.05 to 4.
    density: float = SketchModelSettings.density
    # on gives the tree leaves; off gives it none; auto gives it leaves where the photograph shows them.
    leaves: MakeSketchLeaves = "auto"
    # The leaves have this mean length; auto takes that of the photograph. Unit: metres. Range: above 0, to 10.
    leaf_length_m: float | None = None
    max_leaves: int = SketchModelSettings.max_leaves  # The tree has at most this many leaves. Range: 1 to 1000000.
    crown: bool = True  # true gives the tree a crown for the distance.
    # The surface of the branches has at most this many faces. Range: 1000 or more.
    max_faces: int = SketchModelSettings.max_faces

    def __post_init__(self) -> None:
        if self.tree is not None and not 1 <= self.tree <= MAX_TREES:
            raise ValueError(f"tree must be 1 to {MAX_TREES}, not {self.tree}")
        if self.leaves not in get_args(MakeSketchLeaves):
            raise ValueError(f"leaves must be one of {', '.join(get_args(MakeSketchLeaves))}, not {self.leaves!r}")
        if not 1 <= self.max_leaves <= MAX_SKETCH_LEAVES:
            raise ValueError(f"max_leaves must be 1 to {MAX_SKETCH_LEAVES}, not {self.max_leaves}")
        if self.leaf_length_m is not None and not 0 < self.leaf_length_m <= MAX_LEAF_LENGTH_M:
            raise ValueError(
                f"leaf_length_m must be above 0 and at most {MAX_LEAF_LENGTH_M:g}, not {self.leaf_length_m:g}"
            )
        SketchSettings(height_m=self.height_m, depth=self.depth, growth=SketchGrowthSettings(gravity=self.gravity))
        SketchModelSettings(density=self.density, max_faces=self.max_faces)


@dataclass(frozen=True, kw_only=True)
class PictureStageSettings(PictureSettings):
    """What is drawn of the finished asset; without the preview interpreter nothing is."""

    # true draws pictures, a turntable and a thumbnail. Without the preview interpreter none are drawn.
    make: bool = True


@dataclass(frozen=True, kw_only=True)
class TaskSettings:
    """How the work is cut; it changes no result."""

    photographs_a_task: int = 4  # One task finds the depth of this many photographs. Range: 1 or more.

    def __post_init__(self) -> None:
        if self.photographs_a_task < 1:
            raise ValueError(f"photographs_a_task must be at least 1, not {self.photographs_a_task}")


@dataclass(frozen=True, kw_only=True)
class BuildSettings(SeedSettings):
    """Everything that decides a plant's asset."""

    plant: PlantSettings = field(default_factory=PlantSettings)
    capture: CaptureRunSettings = field(default_factory=CaptureRunSettings)
    isolation: IsolationStageSettings = field(default_factory=IsolationStageSettings)
    branches: BranchStageSettings = field(default_factory=BranchStageSettings)
    leaves: LeafStageSettings = field(default_factory=LeafStageSettings)
    foliage: FoliageSettings = field(default_factory=FoliageSettings)
    crown: CrownStageSettings = field(default_factory=CrownStageSettings)
    sketch: SketchStageSettings = field(default_factory=SketchStageSettings)
    pictures: PictureStageSettings = field(default_factory=PictureStageSettings)
    tasks: TaskSettings = field(default_factory=TaskSettings)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.plant.growth_frames and self.branches.make == "off":
            text = "growth_frames asks for branches, and branches.make is off: set that to auto, or growth_frames to 0"
            raise ValueError(text)


def with_seed(settings: BuildSettings, seed: int) -> BuildSettings:
    """The same settings with this seed in every stage; ValueError for one that cannot be."""
    return set_everywhere(replace(settings, seed=seed), "seed", seed)
