"""What a user says of a build: every stage's settings, one table each."""

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from usdfoliage.asset.packages.leaf_package import LeafAssetSettings
from usdfoliage.errors import FoliageError
from usdfoliage.isolation.pieces import PieceSettings
from usdfoliage.jobs.branches.foliage import FoliageRequest
from usdfoliage.jobs.branches.plant_cloud import PlantCloudRequest, read_roots
from usdfoliage.jobs.capture.settings import CaptureRunSettings
from usdfoliage.jobs.edits.scatter import LENGTHS_M, MOST_LEAVES
from usdfoliage.jobs.leaves.settings import LeavesSettings
from usdfoliage.jobs.plant.pages.pictures import PictureSettings
from usdfoliage.jobs.work.settings_file import set_everywhere

LeafDepth = Literal["auto", "given", "estimated"]
FoliageKind = Literal["auto", "captured", "filled", "drawn", "species", "none"]
MakeBranches = Literal["auto", "on", "off"]
MakeIsolation = Literal["auto", "off"]
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
)  # tables that decide a result


@dataclass(frozen=True, kw_only=True)
class PlantSettings:
    """The plant, and how its asset is written."""

    species: str = ""  # written into the asset; of a known one, as maple, also allometry, twigs and leaves
    representations: tuple[str, ...] | None = None  # of leaves: bezier, nurbs, subdiv, mesh; auto: by their number
    version: str = "1"  # of the asset, in its assetInfo

    def __post_init__(self) -> None:
        if self.representations is not None:
            LeafAssetSettings(representations=self.representations)  # which checks them


@dataclass(frozen=True, kw_only=True)
class IsolationStageSettings:
    """How the plant is told from what is around it; what is left out is in no mask, and in no cloud."""

    make: MakeIsolation = "auto"  # off: everything in the photographs is taken for the plant
    floor: bool = True  # what the plant stands on is left out, if it is nearly level and stands out
    container: bool = True  # its pot is left out, if the plant is green and the pot is not
    strays: bool = True  # what is not linked with the plant is left out, if the photographs are aimed at one
    floor_layer: float = 0.012  # half the thickness of a floor, in distances from the camera to the plant
    link_gap: float = 0.1  # without points, that bridges parts of the plant, 0.03 to 1 of the same distances

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

    make: MakeBranches = "auto"  # auto: where the cloud shows stems or branches; on: whatever it shows; off: none
    roots: str = "auto"  # where stems come out of the ground: auto, a number, or x,y,z in the capture's coordinates
    internode_m: float | None = None  # length of an internode; auto: 0.005 of the plant's height
    cloud_leaves: CloudLeaves = "auto"  # whether the cloud has leaves, which are then left out
    max_points: int = PlantCloudRequest.max_points  # that branches are traced through

    def __post_init__(self) -> None:
        if self.internode_m is not None and not self.internode_m > 0:
            raise ValueError(f"internode_m must be above 0, not {self.internode_m:g}")
        if self.make not in get_args(MakeBranches):
            raise ValueError(f"make must be one of {', '.join(get_args(MakeBranches))}, not {self.make!r}")
        if self.cloud_leaves not in get_args(CloudLeaves):
            raise ValueError(f"cloud_leaves must be one of {', '.join(get_args(CloudLeaves))}, not {self.cloud_leaves}")
        if self.max_points < 50:
            raise ValueError(f"max_points must be at least 50, not {self.max_points}")
        try:
            read_roots(self.roots)
        except FoliageError as error:
            raise ValueError(str(error).replace("--roots", "roots")) from error


@dataclass(frozen=True, kw_only=True)
class LeafStageSettings(LeavesSettings):
    """How single leaves are found in the photographs."""

    make: bool = True  # false: no leaf is looked for
    depth: LeafDepth = "auto"  # given: the capture's own depth/; estimated: by the stage capture; auto: given if there


@dataclass(frozen=True, kw_only=True)
class FoliageSettings:
    """Which leaves the plant has."""

    # captured: those that were found, where they were found; filled: these, and others like them wherever the cloud has
    # leaves besides; drawn: on the twigs, drawn from those that were found; species: on the twigs, of the species;
    # auto: captured if they cover the plant, else filled if the cloud tells leaves, else drawn or species
    kind: FoliageKind = "auto"
    least_cover: float = 0.85  # share of the cloud's leaves that captured leaves must cover, for auto to add no others
    least_drawn: int = 20  # captured leaves to draw from, for auto
    leaf_length_m: float | None = None  # of a leaf on a twig; auto: the species', or the captured leaves'
    max_leaves: int = FoliageRequest().settings.max_leaves  # on twigs

    def __post_init__(self) -> None:
        if self.kind not in get_args(FoliageKind):
            raise ValueError(f"kind must be one of {', '.join(get_args(FoliageKind))}, not {self.kind!r}")
        if not 0 <= self.least_cover <= 1:
            raise ValueError(f"least_cover must be 0 to 1, not {self.least_cover:g}")
        shortest_m, longest_m = LENGTHS_M
        if self.leaf_length_m is not None and not shortest_m <= self.leaf_length_m <= longest_m:
            raise ValueError(f"leaf_length_m must be {shortest_m:g} to {longest_m:g}, not {self.leaf_length_m:g}")
        if not 1 <= self.max_leaves <= MOST_LEAVES:
            raise ValueError(f"max_leaves must be 1 to {MOST_LEAVES}, not {self.max_leaves}")
        if self.least_drawn < 1:
            raise ValueError(f"least_drawn must be at least 1, not {self.least_drawn}")


@dataclass(frozen=True, kw_only=True)
class CrownStageSettings:
    """How the crown is made of the cloud and of photographs, if any."""

    make: bool = True  # false: the plant has no crown
    size: int = 256  # texels a side of a cubemap face
    mesh_size: int = 65  # vertices along an edge of the crown's mesh

    def __post_init__(self) -> None:
        if not 32 <= self.size <= 4096:
            raise ValueError(f"size must be 32 to 4096 texels, not {self.size}")
        if not 2 <= self.mesh_size <= 4097:
            raise ValueError(f"mesh_size must be 2 to 4097, not {self.mesh_size}")


@dataclass(frozen=True, kw_only=True)
class PictureStageSettings(PictureSettings):
    """What is drawn of the finished asset; without the preview interpreter nothing is."""

    make: bool = True  # false: no pictures, no turntable, no thumbnail


@dataclass(frozen=True, kw_only=True)
class TaskSettings:
    """How the work is cut; it changes no result."""

    photographs_a_task: int = 4  # whose depth is found by one task

    def __post_init__(self) -> None:
        if self.photographs_a_task < 1:
            raise ValueError(f"photographs_a_task must be at least 1, not {self.photographs_a_task}")


@dataclass(frozen=True, kw_only=True)
class BuildSettings:
    """Everything that decides a plant's asset."""

    seed: int = 0  # of every random choice, in every stage
    plant: PlantSettings = field(default_factory=PlantSettings)
    capture: CaptureRunSettings = field(default_factory=CaptureRunSettings)
    isolation: IsolationStageSettings = field(default_factory=IsolationStageSettings)
    branches: BranchStageSettings = field(default_factory=BranchStageSettings)
    leaves: LeafStageSettings = field(default_factory=LeafStageSettings)
    foliage: FoliageSettings = field(default_factory=FoliageSettings)
    crown: CrownStageSettings = field(default_factory=CrownStageSettings)
    pictures: PictureStageSettings = field(default_factory=PictureStageSettings)
    tasks: TaskSettings = field(default_factory=TaskSettings)

    def __post_init__(self) -> None:
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"seed must be 0 or more and below 2^31, not {self.seed}")


def with_seed(settings: BuildSettings, seed: int) -> BuildSettings:
    """The same settings with this seed in every stage; ValueError for one that cannot be."""
    return set_everywhere(replace(settings, seed=seed), "seed", seed)
