"""What is read of an asset, and where no command writes, for the gate (usdfoliage.files.write_gate)."""

from dataclasses import dataclass
from pathlib import Path

from usdfoliage.asset.asset_record import is_asset_folder
from usdfoliage.asset.locate import check_layers, open_layer
from usdfoliage.asset.packages.contents import interface_of, list_files, outside_files
from usdfoliage.errors import AssetError, FoliageError
from usdfoliage.files.write_gate import Access


@dataclass(frozen=True, kw_only=True)
class AssetFiles:
    """What is read of an asset, a look or a scene."""

    asset: Path  # the folder of the asset, or the file of a scene
    look: Path | None
    elsewhere: tuple[Path, ...]  # of an asset, what lies outside its folder; of a scene, all that it is composed of

    @property
    def reads(self) -> tuple[Path, ...]:
        return (self.asset, *(() if self.look is None else (self.look,)), *self.elsewhere)


def find_asset(asset: Path) -> AssetFiles:
    """What is read of an asset, a look or a scene.

    It opens USD, so that it runs where the command does, for strangers' assets in the box. A file that cannot be read
    is itself all that is known of it: the command reports what is wrong with it.
    """
    try:
        interface, look = interface_of(asset)
        check_layers(open_layer(interface), interface)  # USD would wait for a pipe among them
        layers, others, _ = list_files(interface)
    except (FoliageError, OSError):
        return AssetFiles(asset=asset, look=None, elsewhere=())
    folder, files = interface.parent, [*layers, *others]
    is_asset = _is_asset(folder)
    names = outside_files(interface, files) if is_asset else [file.path for file in files[1:]]
    return AssetFiles(
        asset=folder if is_asset else interface,
        look=None if look is None else look.path,
        elsewhere=tuple(folder / name for name in names),
    )


def bake_access(asset: Path, output: Path) -> Access:
    """Of a bake, which may replace the asset that it reads."""
    found = find_asset(asset)
    return Access(reads=found.reads, replaces=(output,), keeps=(found.asset,))


def export_access(asset: Path, output: Path) -> Access:
    """Of an export, which never replaces what it reads."""
    return Access(reads=find_asset(asset).reads, replaces=(output,))


def look_access(output: Path, asset: Path, jitter_map: Path | None, taken: Path | None = None) -> Access:
    """Of a look, which may replace the one that it is an edit of, as what that has comes along.

    Args:
        taken: A layer whose edits the look takes, which it may replace too.

    Raises:
        AssetError: The output lies in an asset.
    """
    refuse_in_asset(output)
    found = find_asset(asset)
    reads = (*found.reads, *(file for file in (jitter_map, taken) if file is not None))
    keeps = tuple(file for file in (found.look, taken) if file is not None)
    return Access(reads=reads, replaces=(output,), keeps=keeps)


def refuse_in_asset(output: Path) -> None:
    """Refuse a file in the folder of an asset, where the asset's own files alone are.

    Raises:
        AssetError: It lies in one.
    """
    real = Path(output.parent.resolve()) / output.name
    if real.is_symlink():
        real = real.resolve()
    for folder in real.parents:
        if _is_asset(folder):
            raise AssetError(f"{output} lies in the asset {folder}, which stays as it is", "name a file elsewhere")


def _is_asset(folder: Path) -> bool:
    """Whether a folder is there, can be read, and is an asset."""
    try:
        return is_asset_folder(folder)
    except OSError:  # there is nothing yet, or who writes there reports it
        return False
