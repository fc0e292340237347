"""What stages say of a command's options, said of the settings of a build's plan."""

import re

# What a remark says, and what a build says instead; in this order.
_WORDS: tuple[tuple[str, str], ...] = (
    (r"--roots", "branches.roots"),
    (r"--cloud-leaves (on|off)", r'branches.cloud_leaves = "\1"'),
    (r"--scale, its true length over that one", "its true length over that one as capture.world.times"),
    (r"--up (gps|elevation|level|ground|ring|trunk|photographs)", r'capture.world.up = "\1"'),
    (r"--poses estimate\b", 'capture.poses = "estimate"'),
    (r"under \[registration\] with --settings", "under [capture.registration] in the plan"),
    (r'doubtful_poses = "use" with --settings', 'capture.doubtful_poses = "use" in the plan'),
    (r"with --settings", "in the plan"),
)


def in_words_of_the_plan(remark: str) -> str:
    """The same remark, of settings; options that no setting stands for stay, as they are of single commands."""
    for said, instead in _WORDS:
        remark = re.sub(said, instead, remark)
    return remark
