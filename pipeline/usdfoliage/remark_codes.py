"""Every code that a remark can have: what it means, and what to do. The input guide's tables are made of it."""

from collections.abc import Mapping
from dataclasses import dataclass

SEVERITIES = ("warning", "info")


@dataclass(frozen=True, kw_only=True)
class RemarkKind:
    """What remarks of one code have in common."""

    severity: str  # one of SEVERITIES
    meaning: str  # one or two short sentences
    action: str  # what to do; "nothing" with the reason where there is nothing to do


@dataclass(frozen=True, kw_only=True)
class RemarkSection:
    """A table of the input guide."""

    title: str
    kinds: Mapping[str, RemarkKind]  # by code: lower case, words joined by "-"


SECTIONS: tuple[RemarkSection, ...] = (
    RemarkSection(
        title="Branches",
        kinds={
            "plant-height-improbable": RemarkKind(
                severity="warning",
                meaning="The plant is lower than 5 cm or higher than 130 m. Its unit is probably wrong.",
                action="Give the unit that the remark names.",
            ),
            "stems-not-seen": RemarkKind(
                severity="warning",
                meaning=(
                    "No stem is seen at a root, as in a hedge. How thick branches are is estimated, and twigs may "
                    "be rows of leaves."
                ),
                action=(
                    'Give `branches.roots` where the stems are, or set `branches.make` to `"off"`. In `usdfoliage '
                    "branches`, `--method grow` is another way."
                ),
            ),
            "branches-not-round": RemarkKind(
                severity="warning",
                meaning="No stem or branch of the whole cloud is round. How thick branches are is estimated.",
                action="Make a denser cloud: take nearer photographs, or a scan.",
            ),
            "branches-not-joined": RemarkKind(
                severity="warning",
                meaning=(
                    "A third of the branches or more are not joined to the surface. The cloud shows few of them "
                    "clearly."
                ),
                action='Set `branches.cloud_leaves` to `"on"` if leaves were taken for wood.',
            ),
            "growth-incomplete": RemarkKind(
                severity="warning",
                meaning="Branches were grown through a part of the cloud alone.",
                action="Give a longer internode, or more roots.",
            ),
            "branches-left-out": RemarkKind(
                severity="info",
                meaning=(
                    "The cloud shows no stem at a root and hardly a round branch, as of a hedge, a bed or a wall "
                    "of leaves. The plant has no branches."
                ),
                action='Set `branches.make` to `"on"`, best with `branches.roots`, to trace them nevertheless.',
            ),
            "traced-coarsely": RemarkKind(
                severity="info",
                meaning=(
                    "Traced finely hardly a branch was round, as of a herb with thin stems. The branches are "
                    "traced with longer internodes."
                ),
                action="Look at the stems. Nearer photographs show more of them.",
            ),
            "free-branches-kept": RemarkKind(
                severity="info",
                meaning="Hardly a branch is round. Only branches that stand free of the foliage are kept.",
                action="Look at the stems. Nearer photographs show more of them.",
            ),
            "species-unknown": RemarkKind(
                severity="info",
                meaning=(
                    "The species is not in the library. Its name is written into the asset, and its twigs are "
                    "those of any tree."
                ),
                action="Nothing, or name a species of the library.",
            ),
            "cloud-up": RemarkKind(
                severity="info",
                meaning="Which axis of the cloud points up, and by what it was found.",
                action="Give the up axis if it is wrong.",
            ),
            "ground-left-out": RemarkKind(
                severity="info",
                meaning="Points of the ground are not of the plant.",
                action="Nothing.",
            ),
            "outliers-left-out": RemarkKind(
                severity="info",
                meaning="Points far beside the plant are not of the plant.",
                action="Nothing.",
            ),
            "other-trees-left-out": RemarkKind(
                severity="info",
                meaning="Points belong to other trees than the one at the given root.",
                action="Nothing, or give the roots of all stems of the plant.",
            ),
            "roots-missing": RemarkKind(
                severity="info",
                meaning="Fewer roots were found than were asked for.",
                action="Give the places of the roots.",
            ),
            "cloud-thinned": RemarkKind(
                severity="info",
                meaning="The cloud is denser than branches need, and is thinned evenly.",
                action="Nothing. `branches.max_points` sets how many points are kept.",
            ),
            "cloud-leaves-left-out": RemarkKind(
                severity="info",
                meaning="A share of the points are leaves. Branches are traced without them.",
                action='Set `branches.cloud_leaves` to `"off"` if that is wrong.',
            ),
            "cloud-leaves-unknown": RemarkKind(
                severity="info",
                meaning="The points are too far apart to tell leaves from wood. All are taken for wood.",
                action='Set `branches.cloud_leaves` to `"on"` if the plant has leaves.',
            ),
            "branches-in-skeleton-alone": RemarkKind(
                severity="info",
                meaning="Some branches are in the skeleton and not in the surface. The text counts the reasons.",
                action="Nothing while they are few.",
            ),
            "branches-beside-parent": RemarkKind(
                severity="info",
                meaning="Some branches would cross their parent where they join it. Each begins a piece of its own.",
                action="Nothing.",
            ),
            "branches-grown": RemarkKind(
                severity="info",
                meaning="Branches were grown through the cloud, as was asked for.",
                action="Nothing.",
            ),
            "hidden-branches-grown": RemarkKind(
                severity="info",
                meaning="Branches were grown where the cloud shows none, as was asked for.",
                action="Nothing.",
            ),
            "nothing-hidden": RemarkKind(
                severity="info",
                meaning="The cloud hides no part of the crown. No branches were grown inside it.",
                action="Nothing.",
            ),
            "rig-joints": RemarkKind(
                severity="info",
                meaning="The asset has a rig.",
                action="Select the variant `rig=skel` to move it.",
            ),
        },
    ),
    RemarkSection(
        title="Leaves that are found",
        kinds={
            "no-leaf-found": RemarkKind(
                severity="warning",
                meaning="No leaf was found. The text counts the candidates.",
                action="Take nearer photographs. A build takes leaves of the species instead.",
            ),
            "no-view-with-depth": RemarkKind(
                severity="warning",
                meaning="No photograph has depth, and leaves are found in depth.",
                action="Give depth maps, or let depth be computed from the photographs.",
            ),
            "depth-maps-empty": RemarkKind(
                severity="warning",
                meaning="The capture's own depth maps have no value that can be used.",
                action='Write the maps again, or set `leaves.depth` to `"estimated"`.',
            ),
            "views-without-depth": RemarkKind(
                severity="info",
                meaning="No leaf was looked for in photographs without depth. They give colours alone.",
                action="Nothing, if the others cover the plant.",
            ),
            "one-view": RemarkKind(
                severity="info",
                meaning="There is one photograph. What it does not show is unknown.",
                action="Take photographs from other sides.",
            ),
            "depth-swept": RemarkKind(
                severity="info",
                meaning="Depth was computed from the photographs in a quick way. It is coarse.",
                action="Nothing, or run `usdfoliage capture` first.",
            ),
            "leaves-guessed": RemarkKind(
                severity="info",
                meaning=(
                    "The median confidence of the leaves is low. They are too small in the photographs, lobed, or "
                    "grass."
                ),
                action="See [Single leaves](#single-leaves).",
            ),
            "leaves-lobed": RemarkKind(
                severity="info",
                meaning=(
                    "The edges of most leaves lie off a single silhouette: leaves are lobed, toothed, or of "
                    "several leaflets."
                ),
                action='Take leaves of the species instead: `foliage.kind = "species"`.',
            ),
            "leaf-shape-improbable": RemarkKind(
                severity="info",
                meaning="Leaves are much narrower or wider than leaves of one lobe: grass-like, lobed, or of leaflets.",
                action='Take leaves of the species instead: `foliage.kind = "species"`.',
            ),
            "leaf-axes-uncertain": RemarkKind(
                severity="info",
                meaning="Most leaves are about as wide as long, so that their axis is uncertain.",
                action="Look at the fitted leaves over the photographs.",
            ),
        },
    ),
    RemarkSection(
        title="Leaves on twigs",
        kinds={
            "foliage-chosen": RemarkKind(
                severity="info",
                meaning="Which leaves the plant has, and why.",
                action="Nothing, or choose others with `foliage.kind`.",
            ),
            "leaves-filled-in": RemarkKind(
                severity="info",
                meaning="Leaves like those that were found stand where the cloud has leaves besides.",
                action="Nothing.",
            ),
            "no-leaf-on-twigs": RemarkKind(
                severity="info",
                meaning="The plant has few twigs, and none carries leaves.",
                action="Nothing, or set `branches.cloud_leaves`.",
            ),
            "no-twig-for-leaves": RemarkKind(
                severity="info",
                meaning="No twig is thin enough to carry leaves.",
                action="Nothing, or trace the branches with a shorter internode.",
            ),
            "leaves-left-out": RemarkKind(
                severity="info",
                meaning="More leaves were grown than are allowed. They are thinned evenly.",
                action="Raise `foliage.max_leaves`.",
            ),
            "leaf-length-improbable": RemarkKind(
                severity="info",
                meaning=(
                    "Leaves of the other asset are much longer or shorter than those of the species. Their "
                    "capture may have had no scale."
                ),
                action="Set `foliage.leaf_length_m`.",
            ),
            "bezier-alone": RemarkKind(
                severity="info",
                meaning="There are so many leaves that one representation alone is written.",
                action="Name others with `plant.representations`.",
            ),
            "many-patches": RemarkKind(
                severity="info",
                meaning="The representation nurbs has one prim a leaf. Few applications open so many.",
                action="Leave nurbs out.",
            ),
        },
    ),
    RemarkSection(
        title="Crown",
        kinds={
            "crown-directions-few": RemarkKind(
                severity="warning",
                meaning=(
                    "The crown's points are seen from its centre in a small share of the directions. Elsewhere "
                    "its surface is a guess."
                ),
                action="Give a cloud from all sides, of one plant.",
            ),
            "crown-left-out": RemarkKind(
                severity="warning",
                meaning=(
                    "The crown's outlines and those of the plant have little in common: the plant is slender or "
                    "bare, or there are several."
                ),
                action="Nothing. The plant is shown with its leaves at any distance.",
            ),
            "crown-of-no-leaves": RemarkKind(
                severity="info",
                meaning="The plant has no leaves, and so no crown.",
                action="Nothing.",
            ),
            "crown-colors": RemarkKind(
                severity="info",
                meaning="Where the crown's colours come from.",
                action="Nothing.",
            ),
            "photographs-without-crown": RemarkKind(
                severity="info",
                meaning="Some photographs do not show the crown from outside, and are not used for it.",
                action="Nothing while others show it.",
            ),
            "crown-by-width": RemarkKind(
                severity="info",
                meaning="The cloud's colours do not show leaves. Wide parts of the cloud are taken for the crown.",
                action="Nothing, or give a cloud with colours.",
            ),
            "crown-by-color": RemarkKind(
                severity="info",
                meaning="The crown is made of the green points.",
                action="Nothing.",
            ),
            "points-without-color": RemarkKind(
                severity="info",
                meaning="Black points have no colour. Each is a leaf where the coloured points nearest to it are.",
                action="Nothing.",
            ),
            "mask-of-alpha": RemarkKind(
                severity="info",
                meaning="The crown's mask is the alpha channel of the photograph.",
                action="Nothing.",
            ),
            "mask-proposed": RemarkKind(
                severity="info",
                meaning="No mask is given. One is proposed, with how confident the proposal is.",
                action="Look at the mask. Give one if it is wrong.",
            ),
            "mask-proposal-kept": RemarkKind(
                severity="info",
                meaning="The proposed mask is written beside the asset.",
                action="Correct it, and give it with `--mask` of `usdfoliage crown`.",
            ),
        },
    ),
    RemarkSection(
        title="Looks and bakes",
        kinds={
            "jitter-map-without-jitter": RemarkKind(
                severity="info",
                meaning="A jitter map is set while the amplitude is 0. It shows nothing.",
                action="Give `--jitter` too.",
            ),
            "edits-change-nothing": RemarkKind(
                severity="info",
                meaning="The asset has these edits already, or they are neutral.",
                action="Nothing.",
            ),
            "jitter-finer-than-mesh": RemarkKind(
                severity="info",
                meaning="The waves of the jitter are finer than the mesh of a leaf that bezier shows.",
                action="Bake the asset, which divides it more finely.",
            ),
            "changed-patches-not-read": RemarkKind(
                severity="info",
                meaning="Patches of nurbs were changed, and leaves were read from bezier.",
                action="Read them with `--from nurbs` of `usdfoliage bake`.",
            ),
            "patches-fitted": RemarkKind(
                severity="info",
                meaning="How many patches were changed, and how far the fitted leaves are from them.",
                action="Nothing while the distances are small.",
            ),
            "patches-left-out": RemarkKind(
                severity="info",
                meaning="Some patches are no leaves any more.",
                action="Correct the patch that the text names.",
            ),
            "hidden-leaves-left-out": RemarkKind(
                severity="info",
                meaning="Hidden leaves are not baked.",
                action="Show them first if they are wanted.",
            ),
            "animated-edits": RemarkKind(
                severity="info",
                meaning="The edits change with time. Leaves are baked as at the earliest time.",
                action="Nothing.",
            ),
            "look-left-out": RemarkKind(
                severity="info",
                meaning="The look acts on bezier alone, and leaves were read from nurbs.",
                action="Bake from bezier to keep its edits.",
            ),
            "look-acts-twice": RemarkKind(
                severity="info",
                meaning="The asset was replaced by its baked form, and the look still holds the same edits.",
                action="Take the look out of the scenes.",
            ),
            "representation-left-out": RemarkKind(
                severity="info",
                meaning="The asset has a representation that is not ours.",
                action="Nothing, or keep the old asset.",
            ),
            "jitter-stays-edit": RemarkKind(
                severity="info",
                meaning="Jitter is no parameter of a leaf. It stays an edit of the baked asset.",
                action="Nothing.",
            ),
            "leaf-motion-lost": RemarkKind(
                severity="info",
                meaning=(
                    "The leaves stand elsewhere or are divided otherwise. They no longer follow branches that "
                    "grow or sway."
                ),
                action="Make them again with `usdfoliage branches`.",
            ),
            "trunk-shown-with-crown": RemarkKind(
                severity="info",
                meaning="Parts that stand out of the crown, above all the trunk, are now shown with it.",
                action="Nothing.",
            ),
        },
    ),
    RemarkSection(
        title="Builds",
        kinds={
            "part-failed": RemarkKind(
                severity="warning",
                meaning="A stage could not make its part, and the plant goes without it.",
                action="Read the text, which says why.",
            ),
            "leaves-cover-little": RemarkKind(
                severity="warning",
                meaning=(
                    "The leaves that were found cover a small share of the cloud, and there are no branches for others."
                ),
                action="Take nearer photographs. The crown stands for the plant.",
            ),
            "plant-reaches-little": RemarkKind(
                severity="warning",
                meaning=(
                    "Branches and leaves are near a small share of the cloud. Its points are too far apart, or it "
                    "shows several plants."
                ),
                action="Take nearer photographs, or isolate one plant.",
            ),
            "plant-leaves-guessed": RemarkKind(
                severity="warning",
                meaning="The plant has the leaves that were found, and their median confidence is low.",
                action="See [Single leaves](#single-leaves).",
            ),
            "thumbnail-missing": RemarkKind(
                severity="warning",
                meaning="The asset has no thumbnail, because the preview interpreter could not draw one.",
                action="Read the text, which names the cause. Run the build again.",
            ),
            "pictures-missing": RemarkKind(
                severity="warning",
                meaning="The report has no pictures of the plant, because the preview interpreter could not draw them.",
                action="Read the text, which names the cause. Run the build again.",
            ),
            "report-without-pictures": RemarkKind(
                severity="info",
                meaning="The report of a single command has no pictures of the asset.",
                action="Read the text, which names the cause.",
            ),
        },
    ),
    RemarkSection(
        title="Notes of files",
        kinds={
            "cloud-file-note": RemarkKind(
                severity="info",
                meaning="A note on the cloud's file.",
                action="Read the text.",
            ),
            "cloud-file-warning": RemarkKind(
                severity="warning",
                meaning="A part of the cloud's file is not used.",
                action="Read the text.",
            ),
            "capture-note": RemarkKind(
                severity="info",
                meaning="A note on the capture.",
                action="Read the text.",
            ),
            "capture-warning": RemarkKind(
                severity="warning",
                meaning="The capture contradicts itself.",
                action="Read the text.",
            ),
        },
    ),
)

REMARK_KINDS: Mapping[str, RemarkKind] = {code: kind for section in SECTIONS for code, kind in section.kinds.items()}
