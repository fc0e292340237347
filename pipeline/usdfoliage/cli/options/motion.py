"""What moves in a plant: the options, and what they set, checked."""

import argparse
from typing import TYPE_CHECKING

from usdfoliage.errors import FoliageError

if TYPE_CHECKING:
    from usdfoliage.jobs.branches.motion import BranchMotion


def add_motion(parser: argparse._ActionsContainer) -> None:
    """A rig, its sway, and growth."""
    from usdfoliage.branch.motion.rig import RigSettings
    from usdfoliage.branch.motion.sway_frames import MAX_FRAMES

    parser.add_argument(
        "--rig", action="store_true", help="Write joints that turn the branches (UsdSkel), in the variant rig=skel."
    )
    parser.add_argument(
        "--rig-order",
        metavar="N",
        type=int,
        help="Branches up to this order have a joint, 0 or more; finer branches follow their parent. The default is "
        f"{RigSettings.order}.",
    )
    parser.add_argument(
        "--sway",
        metavar="FRAMES",
        type=int,
        help=f"Write a gentle sway of the rig as a loop of so many frames, 2 to {MAX_FRAMES}. It includes --rig.",
    )
    parser.add_argument(
        "--sway-clips",
        action="store_true",
        help="Write the sway as value clips, which a shot can loop, shift and stretch, in place of time samples.",
    )
    parser.add_argument(
        "--growth",
        metavar="FRAMES",
        type=int,
        help="Write the growth of the plant in so many frames, 2 or more, in the variant growth=growing.",
    )


def read_motion(options: argparse.Namespace) -> "BranchMotion":
    """The motion that a command line asks for."""
    from usdfoliage.branch.motion.rig import RigSettings
    from usdfoliage.branch.motion.sway import SwaySettings
    from usdfoliage.branch.motion.sway_frames import MAX_FRAMES
    from usdfoliage.jobs.branches.motion import BranchMotion

    rig = sway = None
    has_rig = options.rig or options.sway is not None
    if options.rig_order is not None and not has_rig:
        raise FoliageError("--rig-order is of a rig", "add --rig or --sway")
    if options.rig_order is not None and options.rig_order < 0:
        raise FoliageError(f"--rig-order must be 0 or more, not {options.rig_order}")
    if options.growth is not None and options.growth < 2:
        raise FoliageError(f"--growth must be 2 frames or more, not {options.growth}")
    if options.sway is not None and not 2 <= options.sway <= MAX_FRAMES:
        raise FoliageError(f"--sway must be 2 to {MAX_FRAMES} frames, not {options.sway}")
    if has_rig:
        rig = RigSettings() if options.rig_order is None else RigSettings(order=options.rig_order)
    if options.sway is not None:
        sway = SwaySettings(frames=options.sway)
    elif options.sway_clips:
        raise FoliageError("--sway-clips is of a sway", "add --sway")
    return BranchMotion(rig=rig, sway=sway, sway_clips=options.sway_clips, growth_frames=options.growth or 0)
