"""How a command writes the settings that remedies name: a build as its plan has them, the others as their options."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from usdfoliage.files.printable import printable
from usdfoliage.remarks import Argument, Remark, RenderSetting, Setting, as_plan_setting, label_remarks


@dataclass(frozen=True, kw_only=True)
class CommandOptions:
    """What a command calls settings of a build, and its arguments."""

    options: Mapping[str, str] = field(default_factory=dict)  # by the name of the setting
    arguments: Mapping[str, str] = field(default_factory=dict)  # options by the name of the argument, beside OF_A_RUN
    values: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # of settings whose option has other words
    table: str = ""  # whose settings are the keys of the file that --settings takes; "": there is no such file


LEAVES_OF_A_CLOUD = "leaves of a cloud"  # the command leaves, where its input is a cloud alone
_OF_A_CLOUD = {"capture.toml:metres_per_unit": "--unit", "capture.toml:up_axis": "--up", "branches.roots": "--roots"}

_UNITS = {"": "m|cm|mm|ft", "1": "m", "0.01": "cm", "0.001": "mm", "0.3048": "ft"}

COMMANDS: Mapping[str, CommandOptions] = {
    "capture": CommandOptions(
        options={
            "capture.poses": "--poses",
            "capture.mask": "--mask",
            "capture.dense": "--dense",
            "capture.pose_estimation.matching": "--matching",
            "capture.pose_estimation.one_camera": "--camera",
            "capture.world.times": "--scale",
            "capture.world.up": "--up",
            "capture.world.up_vector": "--up",
            "seed": "--seed",
        },
        values={"capture.pose_estimation.one_camera": {"yes": "one", "no": "several"}},
        table="capture",
    ),
    "branches": CommandOptions(
        options={
            **_OF_A_CLOUD,
            "branches.internode_m": "--internode",
            "branches.cloud_leaves": "--cloud-leaves",
            "branches.make": "--any-cloud",
            "branches.method": "--method",
            "branches.variation_spread": "--variation-spread",
            "branches.max_points": "--most-points",
            "branches.max_faces": "--most-faces",
            "foliage.leaf_length_m": "--leaf-length",
            "foliage.max_leaves": "--most-leaves",
            "plant.species": "--species",
            "plant.representations": "--representation",
            "seed": "--seed",
        },
        values={"capture.toml:metres_per_unit": _UNITS, "branches.make": {"on": ""}},
        arguments={"species_file": "--species-file"},
    ),
    "crown": CommandOptions(
        options={
            **_OF_A_CLOUD,
            "capture.toml:color_space": "--color-space",
            "crown.size": "--size",
            "crown.mesh_size": "--mesh-size",
            "plant.species": "--species",
            "seed": "--seed",
        },
        values={"capture.toml:metres_per_unit": _UNITS},
        arguments={"mask": "--mask"},
    ),
    "sketch": CommandOptions(
        options={
            "branches.max_faces": "--most-faces",
            "capture.toml:color_space": "--color-space",
            "foliage.leaf_length_m": "--leaf-length",
            "foliage.max_leaves": "--most-leaves",
            "plant.representations": "--representation",
            "plant.species": "--species",
            "seed": "--seed",
            "sketch.leaves": "--leaves",
        },
        arguments={"leaf": "--leaf", "mask": "--mask", "species_file": "--species-file", "strokes": "--strokes"},
    ),
    "forest": CommandOptions(
        options={},
        arguments={
            "camera": "--camera",
            "canopy": "--canopy",
            "camera_prim": "--camera-prim",
            "ground_spacing": "--ground-spacing",
            "max_terrain_quads": "--max-terrain-quads",
            "tile": "--tile",
            "vegetation": "--vegetation",
        },
    ),
    "leaves": CommandOptions(
        options={
            "leaves.depth": "--depth",
            "leaves.method": "--method",
            "leaves.min_confidence": "--min-confidence",
            "plant.hold_back": "--hold-back",
            "plant.species": "--species",
            "plant.representations": "--representation",
            "seed": "--seed",
        },
        table="leaves",
    ),
    LEAVES_OF_A_CLOUD: CommandOptions(
        options={
            **{name: option for name, option in _OF_A_CLOUD.items() if name != "branches.roots"},
            "leaves.min_confidence": "--min-confidence",
            "plant.species": "--species",
            "plant.representations": "--representation",
            "seed": "--seed",
        },
        values={"capture.toml:metres_per_unit": _UNITS},
        table="leaves",
    ),
    "lobed": CommandOptions(
        options={"capture.toml:color_space": "--color-space", "plant.species": "--species", "seed": "--seed"},
        arguments={"mask": "--mask", "dpi": "--dpi", "width": "--width", "height": "--height"},
    ),
    "bake": CommandOptions(arguments={"source": "--from"}),
    "export": CommandOptions(arguments={"shapes": "--shapes"}),
    "edit": CommandOptions(arguments={"jitter": "--jitter", "prim": "--prim"}),
    "scatter": CommandOptions(options={"plant.representations": "--representation"}),
}

OF_A_RUN = {
    "output": "-o",
    "force": "--force",
    "keep_old": "--keep-old",
}  # what every command that writes takes, by the name of the argument


def render_for(command: str) -> RenderSetting:
    """How a command writes a setting: its own option, else a key of the file of --settings, else as a plan has it."""
    own = COMMANDS.get(command, CommandOptions())

    def render(setting: Setting | Argument) -> str:
        if isinstance(setting, Argument):
            option = {**OF_A_RUN, **own.arguments}.get(setting.name)
            return str(setting) if option is None else f"{option} {setting.value}".rstrip()
        option = own.options.get(setting.name)
        if option is not None:
            value = setting.value.strip('"')
            words = own.values.get(setting.name)
            if words is None or value in words:
                value = value if words is None else words[value]
                return f"{option} {value}" if value else option
        is_of_file = ":" in setting.name  # capture.toml's, which no table of settings has
        if own.table and setting.name.startswith(f"{own.table}.") and not is_of_file:
            key = setting.name.removeprefix(f"{own.table}.")
            return f"{as_plan_setting(Setting(name=key, value=setting.value))} in the settings file"
        return as_plan_setting(setting)

    return render


def print_remarks(remarks: Iterable[Remark], command: str, show: Callable[[str], None] = print) -> None:
    """Show remarks on the terminal, a line each, the warnings first, as a command writes its settings."""
    for line in label_remarks(remarks, render_for(command)):
        show(printable(line))
