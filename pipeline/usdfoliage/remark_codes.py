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
        title="Photographs",
        kinds={
            "photographs-blurred": RemarkKind(
                severity="warning",
                meaning=(
                    "These photographs are less than half as sharp as the median one: shaken, or out of focus. They "
                    "are used."
                ),
                action="Leave them out of the folder if neighbours cover for them, or take them again.",
            ),
            "photographs-unusable": RemarkKind(
                severity="info",
                meaning="Files are damaged, or their size is not that of their camera. They are left out.",
                action="Copy the files again, or give the pictures that the cameras belong to.",
            ),
            "photographs-left-out": RemarkKind(
                severity="warning",
                meaning="These photographs have no part in the plant. The remark names the reason of each.",
                action="Do what the reasons ask for. A few that are lost do no harm.",
            ),
            "photograph-copies-left-out": RemarkKind(
                severity="info",
                meaning="Files hold the same bytes as another photograph. One of each is used.",
                action="Nothing, as they are left out.",
            ),
            "photograph-copies-used": RemarkKind(
                severity="warning",
                meaning=(
                    "Photographs with given poses hold the same bytes. A place that only a photograph and its copy "
                    "show counts as seen once."
                ),
                action="Remove the copies from images/ and cameras/.",
            ),
            "withheld-not-compared": RemarkKind(
                severity="info",
                meaning=(
                    "Photographs that were withheld have no camera, or cannot be read. The asset is not measured by "
                    "them."
                ),
                action="Nothing, if others were withheld too.",
            ),
            "withheld-surroundings-green": RemarkKind(
                severity="warning",
                meaning=(
                    "Photographs that were withheld have no mask, and the plant's surroundings are as green as the "
                    "plant, as on a lawn. The asset is drawn over them and not measured by them."
                ),
                action="Give masks of the withheld photographs, in masks/, or look at the pictures in the report.",
            ),
            "raw-photographs-not-used": RemarkKind(
                severity="info",
                meaning=(
                    "Raw or HEIC files have the name of another photograph, as cameras and phones write two of one "
                    "moment. The other one is used."
                ),
                action="Move the others away to use the raw or HEIC files.",
            ),
            "videos-not-used": RemarkKind(
                severity="info",
                meaning="A video lies beside photographs. They are used, and it is not.",
                action="Give the video itself, in place of its folder, to use it. Photographs are sharper.",
            ),
            "video-frames-taken": RemarkKind(
                severity="info",
                meaning="The sharpest frames of a video are the photographs, one for each part of its way.",
                action="Nothing. `capture.video` has the settings.",
            ),
            "video-frames-limited": RemarkKind(
                severity="info",
                meaning="The video is long: fewer frames are taken than its way would give.",
                action=(
                    "Nothing, if neighbouring frames overlap by two thirds. Otherwise raise the limit or cut the video."
                ),
            ),
            "other-files-not-used": RemarkKind(
                severity="info",
                meaning="Files beside the photographs are no photographs.",
                action="Nothing, unless one of them should be a photograph.",
            ),
            "photographs-in-folders-below": RemarkKind(
                severity="info",
                meaning="Of a plain folder only the photographs at its top are used.",
                action="Put what belongs together into one folder, or make a capture with images/.",
            ),
            "photograph-sizes-differ": RemarkKind(
                severity="info",
                meaning=(
                    "Several cameras took the photographs, or some are cropped. Each size gets a camera of its own."
                ),
                action="Use the originals, uncropped.",
            ),
            "orientation-ignored": RemarkKind(
                severity="info",
                meaning=("Given poses belong to the pixels as the file stores them, whatever orientation EXIF states."),
                action="Nothing, if the poses are COLMAP's.",
            ),
            "color-profile-unknown": RemarkKind(
                severity="warning",
                meaning=(
                    "The file states a colour profile that is not known. It is read as sRGB, and colours may be wrong."
                ),
                action="Convert the photographs to sRGB, or state `color_space` in `capture.toml`.",
            ),
            "camera-scaled": RemarkKind(
                severity="info",
                meaning="The cameras were computed at another size of the pictures.",
                action="Nothing, if the pictures were only resized.",
            ),
            "views-without-mask": RemarkKind(
                severity="info",
                meaning="There are masks, but not of these photographs.",
                action="Nothing, or give the missing masks.",
            ),
            "mask-ignored": RemarkKind(
                severity="warning",
                meaning="The mask cannot be read, has another size than its photograph, or is empty or full.",
                action="Write it again, white on the plant, on the photograph's pixels.",
            ),
            "masks-beside-plant": RemarkKind(
                severity="warning",
                meaning=(
                    "What is green in the photographs would lie within the masks if these were all moved the same way. "
                    "They cut off leaves, and what is beside the plant is taken for it."
                ),
                action='Make the masks of the same photographs again, or set `capture.mask` to `"none"`.',
            ),
            "masks-disagree": RemarkKind(
                severity="warning",
                meaning=(
                    "Masks cut off parts of the plant that other photographs show within theirs. Leaves there are not "
                    "found, or cut."
                ),
                action="See that each mask belongs to its photograph, and make it a few pixels wider than the plant.",
            ),
            "mask-in-pieces": RemarkKind(
                severity="info",
                meaning="The mask of a crown has several components. The largest is taken.",
                action="Nothing, if the others are specks. Otherwise connect them in the mask.",
            ),
            "mask-holes-filled": RemarkKind(
                severity="info",
                meaning="Sky that shows through the crown is filled in the silhouette.",
                action="Nothing, as the gaps stay out of the crown's colours.",
            ),
            "mask-holes-kept": RemarkKind(
                severity="info",
                meaning="Holes of the mask are too large to be filled.",
                action="Nothing, or fill them in the mask.",
            ),
            "mask-at-border": RemarkKind(
                severity="info",
                meaning="The crown reaches the edge of the picture and is cut there.",
                action="Photograph the whole crown.",
            ),
            "plant-at-border": RemarkKind(
                severity="warning",
                meaning="The plant is cut by the border of most photographs. What lies beyond it is missing.",
                action="Nothing for a part of a plant, a hedge or a lawn. Otherwise step back.",
            ),
            "exposures-differ": RemarkKind(
                severity="warning",
                meaning="Photographs differ much in exposure. Fewer leaves are found, and colours are less certain.",
                action="Photograph with manual exposure, the same for all.",
            ),
            "capture-keys-unknown": RemarkKind(
                severity="info",
                meaning="The file capture.toml has keys that mean nothing here. They may be misspelt.",
                action="Compare them with the table of keys in this guide.",
            ),
        },
    ),
    RemarkSection(
        title="Poses",
        kinds={
            "poses-improbable": RemarkKind(
                severity="warning",
                meaning=(
                    "One of the three checks that follow it failed: a focal length, points in a band, or few "
                    "points. The settings ask to go on."
                ),
                action="Do what those remarks ask for.",
            ),
            "focal-length-improbable": RemarkKind(
                severity="warning",
                meaning="The lens is unknown, or was estimated wrongly. Without further settings the run ends here.",
                action="Give the focal length in pixels of the full picture.",
            ),
            "few-points-seen": RemarkKind(
                severity="warning",
                meaning=(
                    "Most photographs are hardly connected with the others. Without further settings the run ends here."
                ),
                action="Take more photographs, nearer to each other.",
            ),
            "points-in-a-band": RemarkKind(
                severity="warning",
                meaning=(
                    "Only a horizon joins the photographs, so that the cameras are not determined. Without "
                    "further settings the run ends here."
                ),
                action="Put something textured around the plant, or give poses in cameras/.",
            ),
            "photographs-not-registered": RemarkKind(
                severity="info",
                meaning=(
                    "No camera was found for these photographs: too few features, another scene, too far from the "
                    "next, a group of its own, or a camera that only turned."
                ),
                action="Take photographs between them and the others. A few that are lost do no harm.",
            ),
            "pairs-contradict": RemarkKind(
                severity="info",
                meaning=(
                    "Pairs of photographs contradict the others, as equal walls or tiles make them. Cameras were found "
                    "without these pairs."
                ),
                action="See that the cameras in the report stand where you stood.",
            ),
            "matches-fit-no-motion": RemarkKind(
                severity="info",
                meaning="Wind moved the plant between photographs, or its texture repeats.",
                action="Photograph in less wind, with texture around the plant that does not repeat.",
            ),
            "several-cameras": RemarkKind(
                severity="info",
                meaning=(
                    "The photographs differ in size, make, model or focal length. Each kind gets a lens of its own."
                ),
                action="Nothing, if there were several cameras.",
            ),
            "poses-estimated": RemarkKind(
                severity="info",
                meaning="The remark has what up and scale were taken from.",
                action="Nothing, if they are right.",
            ),
            "scale-unknown": RemarkKind(
                severity="warning",
                meaning=(
                    "There is no scale bar, no known distance and no usable positions. Every length of the "
                    "plant is in an unknown unit."
                ),
                action="See [Scale and up](#scale-and-up).",
            ),
            "positions-contradict-pictures": RemarkKind(
                severity="info",
                meaning="Positions by satellite are too coarse for so small a ring of cameras.",
                action="Give a scale bar.",
            ),
            "positions-not-usable": RemarkKind(
                severity="info",
                meaning="Positions by satellite are all the same, or have no altitude.",
                action="Give a scale bar.",
            ),
            "up-estimated": RemarkKind(
                severity="info",
                meaning=(
                    "The file `capture.toml` does not state where up is for given poses. It was found as the remark "
                    "has it."
                ),
                action="Nothing, if the asset stands upright. Otherwise state `up_axis` or `up_vector`.",
            ),
            "scale-estimated": RemarkKind(
                severity="info",
                meaning=(
                    "The file `capture.toml` does not state the unit of given poses. It was found as the remark has it."
                ),
                action="Nothing, if the asset has its size. Otherwise state `metres_per_unit`.",
            ),
            "up-uncertain": RemarkKind(
                severity="warning",
                meaning="The evidence for the up direction is weak: it may be wrong by more than 5°.",
                action="Choose another method, or give the direction.",
            ),
            "up-methods-disagree": RemarkKind(
                severity="info",
                meaning="Two methods of finding up contradict each other. The surer one is taken.",
                action="Check the result, and choose the other method where it is wrong.",
            ),
            "cameras-without-photograph": RemarkKind(
                severity="info",
                meaning="Names in cameras/ are in no file of images/.",
                action="Make the names the same, or nothing if those photographs were left out on purpose.",
            ),
            "photographs-without-camera": RemarkKind(
                severity="info",
                meaning="Photographs are not in the model of cameras/, and are not used.",
                action="Make the names the same, or add their cameras to the model.",
            ),
            "model-points-not-used": RemarkKind(
                severity="info",
                meaning=(
                    "The points of the model in cameras/ cannot be read. They only help to choose depths and "
                    "to check the scale."
                ),
                action="Export the model again.",
            ),
        },
    ),
    RemarkSection(
        title="Depth and cloud",
        kinds={
            "photographs-without-companion": RemarkKind(
                severity="info",
                meaning="No other photograph shows the same at an angle from which depth can be computed.",
                action="Take photographs beside it, 5° to 10° apart.",
            ),
            "photographs-without-depth": RemarkKind(
                severity="warning",
                meaning="No depth was found that other photographs confirm.",
                action="Take more photographs beside them.",
            ),
            "plant-without-depth": RemarkKind(
                severity="warning",
                meaning=(
                    "Photographs do not agree on much of what is green: leaves moved between them, or photographs are "
                    "too far apart or blurred, or masks or poses are wrong. Fewer leaves are found."
                ),
                action="Photograph without wind, and from places that are nearer to each other. Check masks and poses.",
            ),
            "reprojection-errors-high": RemarkKind(
                severity="warning",
                meaning=(
                    "Points are far from where these photographs show them. The camera or the plant may have moved."
                ),
                action="Leave the photographs out, or take them again.",
            ),
            "photographs-in-groups": RemarkKind(
                severity="warning",
                meaning=(
                    "Groups of photographs share no matches, and the cloud may consist of parts that do not "
                    "fit each other."
                ),
                action="Take photographs between the groups.",
            ),
            "tasks-done-before": RemarkKind(
                severity="info",
                meaning="Results of an earlier run with the same input and settings are used.",
                action="Nothing.",
            ),
            "given-maps-kept": RemarkKind(
                severity="info",
                meaning=(
                    "The capture has depth, normals or confidence of its own. What was computed is written beside them."
                ),
                action="Nothing, or replace them as the remark describes.",
            ),
            "views-without-depth-map": RemarkKind(
                severity="info",
                meaning="There are no depth maps of these photographs.",
                action="Nothing, if the others cover the plant.",
            ),
            "depth-maps-without-photograph": RemarkKind(
                severity="info",
                meaning="Depth maps have names that no photograph has.",
                action="Name them as their photographs.",
            ),
            "depth-map-ignored": RemarkKind(
                severity="info",
                meaning="The depth map cannot be read, or has another size than its photograph.",
                action="Write it again, on the photograph's pixels.",
            ),
            "depth-map-empty": RemarkKind(
                severity="info",
                meaning="The depth map has no depth at all.",
                action="Write it again.",
            ),
            "depth-maps-unusable": RemarkKind(
                severity="info",
                meaning="None of the given depth maps can be used. Depth is computed from the photographs instead.",
                action="Write the depth maps again.",
            ),
            "depths-impossible": RemarkKind(
                severity="info",
                meaning="Values that are not finite, negative or beyond 1000 km are taken as no depth.",
                action="Nothing, if they stand for unknown depth.",
            ),
            "depth-channel-assumed": RemarkKind(
                severity="info",
                meaning="The depth map has one channel, whose name is not Z.",
                action="Nothing, if that channel is the depth.",
            ),
            "depth-unit-differs": RemarkKind(
                severity="warning",
                meaning="Depth and poses have different units.",
                action="Give depth in metres, and the unit of the poses as metres_per_unit.",
            ),
            "depth-units-mixed": RemarkKind(
                severity="warning",
                meaning="Depth maps have different units, and no unit is used by more than half of them.",
                action="Give all depth in metres.",
            ),
            "depth-of-other-unit-left-out": RemarkKind(
                severity="warning",
                meaning="Some depth maps have another unit than the majority. Their depth is left out.",
                action="Give all depth in metres.",
            ),
            "cloud-file-chosen": RemarkKind(
                severity="info",
                meaning="The remark names the file that is read as the capture's cloud.",
                action="Nothing, or give another file.",
            ),
            "cloud-unit-assumed": RemarkKind(
                severity="info",
                meaning=(
                    "The file of the cloud states no unit. It is assumed from the format, or from the size "
                    "of the cloud."
                ),
                action="Check the size in the report, and set the unit where it is wrong.",
            ),
            "cloud-unit-stated": RemarkKind(
                severity="info",
                meaning="The file of the cloud states a unit other than metres, which is used.",
                action="Nothing.",
            ),
            "cloud-unit-overridden": RemarkKind(
                severity="info",
                meaning="The file of the cloud states another unit than the one that was given. The given one is used.",
                action="Nothing, if the given unit is right.",
            ),
            "cloud-system-in-degrees": RemarkKind(
                severity="info",
                meaning="The file states degrees, but its points are too far apart for them.",
                action="Check the unit.",
            ),
            "cloud-system-unknown": RemarkKind(
                severity="info",
                meaning="The file names a coordinate system by its number only.",
                action="Check the unit.",
            ),
            "cloud-coordinates-coarse": RemarkKind(
                severity="info",
                meaning="Coordinates of a survey have lost their digits.",
                action="Export them as double, or with the offset subtracted.",
            ),
            "cloud-file-thinned": RemarkKind(
                severity="info",
                meaning="The cloud has more points than are used. One a cell of a grid is kept.",
                action="Nothing.",
            ),
            "cloud-points-left-out": RemarkKind(
                severity="info",
                meaning="Points are not finite, marked as noise or withheld, duplicates, or lines that are no points.",
                action="Nothing, unless most are left out.",
            ),
            "cloud-colors-black": RemarkKind(
                severity="info",
                meaning="All colours of the cloud are black. They are not used.",
                action="Export the cloud without colours, or with those of photographs.",
            ),
            "cloud-colors-false": RemarkKind(
                severity="warning",
                meaning="The colours of the cloud stand for height, intensity or another quantity. They are not used.",
                action="Export the cloud with the colours of photographs, or without any.",
            ),
        },
    ),
    RemarkSection(
        title="Isolation",
        kinds={
            "isolation-failed": RemarkKind(
                severity="warning",
                meaning=(
                    "The plant could not be separated from its surroundings, for the reason that the remark "
                    "has. Everything in the photographs is taken for the plant."
                ),
                action='Give masks, or set `isolation.make` to `"off"`.',
            ),
            "isolation-nothing-left": RemarkKind(
                severity="warning",
                meaning=(
                    "Without floor and surroundings hardly a point was left. Everything in the photographs "
                    "is taken for the plant."
                ),
                action='Give masks, or set `isolation.make` to `"off"`, which does the same without the warning.',
            ),
            "isolation-plant-small": RemarkKind(
                severity="warning",
                meaning="The plant is small in a large room, or the wrong thing was taken for it.",
                action="Check the outlines, and give masks where they are wrong.",
            ),
            "isolation-plant-large": RemarkKind(
                severity="warning",
                meaning="Floor and background were not separated from the plant, or there were none.",
                action="Check the outlines. Give masks, or sharper photographs in full size.",
            ),
            "isolation-masks-unchanged": RemarkKind(
                severity="info",
                meaning="The plant stands before a plain background, or was cut out before.",
                action="Nothing.",
            ),
            "isolation-no-aim": RemarkKind(
                severity="info",
                meaning="The axes of the photographs do not meet: they were taken from the air, or along a hedge.",
                action="Nothing, if all that stands on the ground is the plant.",
            ),
            "isolation-no-floor": RemarkKind(
                severity="info",
                meaning="No level layer stands out below the plant.",
                action="Nothing, or give masks where there is a floor.",
            ),
            "isolation-hardly-green": RemarkKind(
                severity="info",
                meaning=(
                    "A pot is recognised by what is not green below what is. Hardly anything is green, so "
                    "that the pot may have stayed."
                ),
                action="Give masks without the pot.",
            ),
            "isolation-container-unclear": RemarkKind(
                severity="info",
                meaning="Something like a pot was found, but not surely. It stays part of the plant.",
                action="Give masks without the pot.",
            ),
            "isolation-hanging-parts": RemarkKind(
                severity="info",
                meaning="Green parts hang over the edge of what the plant stands on.",
                action="Nothing, if they are the plant's.",
            ),
            "isolation-other-plant": RemarkKind(
                severity="warning",
                meaning="Another plant stands in the photographs, and is left out.",
                action=(
                    "Look whether it is the right one that was taken. Else give masks of the plant, or photographs "
                    "that are aimed at it."
                ),
            ),
            "isolation-wall-left-out": RemarkKind(
                severity="info",
                meaning="Something wide without leaves, such as a wall, stands beside the plant, and is left out.",
                action="Nothing, or give masks where it is a part of the plant.",
            ),
            "isolation-several-stands": RemarkKind(
                severity="warning",
                meaning=(
                    "Several parts of about equal size stand on the ground, and nothing links them: stems of one "
                    "plant, or several plants. All are in the asset, as one plant."
                ),
                action="Nothing, if it is one plant. Else give masks of one plant at a time, and build each by itself.",
            ),
            "photographs-without-plant": RemarkKind(
                severity="info",
                meaning="Nothing of the plant is seen in these photographs.",
                action="Nothing.",
            ),
        },
    ),
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
                    'Give `branches.roots` where the stems are, set `branches.method` to `"grow"`, or set '
                    '`branches.make` to `"off"`.'
                ),
            ),
            "branches-not-round": RemarkKind(
                severity="warning",
                meaning="No stem or branch of the whole cloud is round. How thick branches are is estimated.",
                action="Make a denser cloud: take nearer photographs, or a scan.",
            ),
            "branches-beyond-faces": RemarkKind(
                severity="warning",
                meaning="More than 30 % of the branches are left out: the surface would have too many faces.",
                action="Cut the plant out of the cloud, or set `branches.max_faces`.",
            ),
            "branches-not-joined": RemarkKind(
                severity="warning",
                meaning=(
                    "More than 30 % of the branches are not joined to the surface. The cloud shows few of them clearly."
                ),
                action=(
                    'Set `branches.cloud_leaves` to `"on"` if leaves were taken for wood, or `branches.method` to '
                    '`"grow"`.'
                ),
            ),
            "growth-incomplete": RemarkKind(
                severity="warning",
                meaning=(
                    "With the internode that was given, branches were grown to less than 95 % of the cloud's points."
                ),
                action="Give a longer internode, more roots, or no internode: then it follows the cloud.",
            ),
            "variations-incomplete": RemarkKind(
                severity="warning",
                meaning=(
                    "These variations grew to less than 95 % of the points that the plant's cloud has in their own "
                    "envelopes. Parts of their crowns may be empty."
                ),
                action="Look at them. Give a lower `branches.variation_spread`, or do not use them.",
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
            "stems-of-photographs": RemarkKind(
                severity="info",
                meaning=(
                    "The cloud shows few round branches, as of a herb with thin stems. The stems are traced as lines "
                    "that several photographs show, from the soil to the leaves."
                ),
                action="Look at the stems. Nearer photographs show more of them.",
            ),
            "stems-not-looked-for": RemarkKind(
                severity="warning",
                meaning=(
                    "The photographs cannot be searched for stems, for the reason that the remark has. The branches "
                    "are those that the cloud shows."
                ),
                action="Correct what the text names.",
            ),
            "stems-from-given-roots": RemarkKind(
                severity="info",
                meaning=(
                    "The places of roots are given, and the cloud is traced from them. Stems are not looked for in the "
                    "photographs then."
                ),
                action='Nothing, or set `branches.roots` to `"auto"`, as for a herb with thin stems.',
            ),
            "stems-of-nothing": RemarkKind(
                severity="info",
                meaning="Nothing of the cloud is above what the plant stands on: there is nowhere to look for stems.",
                action="Check what isolation left of the plant.",
            ),
            "stems-too-thick-for-lines": RemarkKind(
                severity="info",
                meaning=(
                    "The thickest stem of the cloud is too thick to be a thin line in the photographs, as of a tree. "
                    "Branches are those that the cloud shows."
                ),
                action="Nothing.",
            ),
            "stems-in-few-photographs": RemarkKind(
                severity="info",
                meaning="Stems are lines that two photographs or more show, and there are fewer.",
                action="Take more photographs.",
            ),
            "stems-without-lines": RemarkKind(
                severity="info",
                meaning=(
                    "The cloud shows few round branches, and the photographs no thin line in the same place, so that "
                    "the plant has the branches of the cloud."
                ),
                action="Take sharper photographs, nearer to each other, in which stems are two pixels wide or more.",
            ),
            "stems-not-joined": RemarkKind(
                severity="info",
                meaning=(
                    "The cloud shows few round branches, and the photographs too little of stems to join from the soil "
                    "to the leaves. The plant has the branches of the cloud."
                ),
                action="Take photographs that show the stems, from lower down.",
            ),
            "many-leaves-turned-to-stems": RemarkKind(
                severity="warning",
                meaning=(
                    "Stems lead to what was taken for the apices of more than 15 % of the leaves, and of more than the "
                    "certainty of their bases explains. These leaves are turned end for end. Either stems are wrong, "
                    "or what was known of the bases."
                ),
                action="Look at the stems and at the leaves on them.",
            ),
            "leaves-turned-to-stems": RemarkKind(
                severity="info",
                meaning=(
                    "Stems lead to ends of leaves that were taken for apices. These leaves are turned end for end. "
                    "Without a stem the shape of a leaf often leaves open which end is its base."
                ),
                action="Nothing.",
            ),
            "stems-apart-left-out": RemarkKind(
                severity="info",
                meaning=(
                    "Pieces look like stems, but nothing leads from the plant to them. They are left out; the remark "
                    "has their lengths, and their places in the asset, in metres."
                ),
                action="Take photographs that show how these pieces are joined to the plant.",
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
            "cloud-up-unusual": RemarkKind(
                severity="warning",
                meaning=(
                    "The axis that points up is neither +Z nor +Y, as it is in nearly all files. A limb that leans may "
                    "be taken for a trunk where the cloud is a part of a plant."
                ),
                action="Look at the picture of the plant, and give the up axis if it is wrong.",
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
            "noise-left-out": RemarkKind(
                severity="info",
                meaning="Points all over the box of the cloud are noise, and not of the plant.",
                action="Nothing, or look where thin twigs are missing.",
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
                meaning="The points are too far apart to separate leaves from wood. All are taken for wood.",
                action='Set `branches.cloud_leaves` to `"on"` if the plant has leaves.',
            ),
            "branches-not-in-surface": RemarkKind(
                severity="info",
                meaning=(
                    "Some branches cannot be in the surface, so they are left out of the skeleton too. The text counts "
                    "the reasons."
                ),
                action="Nothing while they are few.",
            ),
            "branches-plain": RemarkKind(
                severity="info",
                meaning="The thinnest branches are tubes of four sides, because the surface would have too many faces.",
                action="Raise `branches.max_faces` if more may be drawn.",
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
            "rest-grown": RemarkKind(
                severity="info",
                meaning="Branches were grown, or grew on, into what others leave of the cloud.",
                action="Nothing. `foliage:inferred` of the skeleton is 1 for those whose larger part grew so.",
            ),
            "rest-out-of-reach": RemarkKind(
                severity="info",
                meaning="No branch grows to the points that branches leave: they are too far from all of them.",
                action="Give a longer internode, or places of roots, if these points are of the plant.",
            ),
            "nothing-left": RemarkKind(
                severity="info",
                meaning="Traced branches leave nothing of the cloud. No branch was grown into it.",
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
            "depth-estimated": RemarkKind(
                severity="info",
                meaning="The capture has no depth maps, or they were not asked for. Depth was computed.",
                action="Nothing. Maps of a scanner, if you have them, give more leaves.",
            ),
            "leaves-guessed": RemarkKind(
                severity="warning",
                meaning=(
                    "Fewer than half of the leaves are right, by the sum of their confidences. They are lobed or "
                    "grass, or depth does not show them."
                ),
                action="See [Single leaves](#single-leaves).",
            ),
            "leaves-not-green-left-out": RemarkKind(
                severity="info",
                meaning=(
                    "Leaves that are not green are few among green ones. They are taken for pieces of soil and dead "
                    "leaves, and left out. The remark has their number."
                ),
                action="Set `leaves.max_not_green = 0` if the plant has such leaves, as red young ones.",
            ),
            "leaves-small": RemarkKind(
                severity="info",
                meaning=(
                    "The median leaf is less than 40 pixels long in its photograph. Where depth is estimated, most "
                    "leaves of this size are lost."
                ),
                action="Take nearer photographs. A build fills in others where the cloud has leaves.",
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
            "no-leaf-in-cloud": RemarkKind(
                severity="warning",
                meaning="No region of the cloud is like a leaf. The asset has none.",
                action="Scan from nearer, so that a leaf has 30 points or more. Filter noise out before.",
            ),
            "cloud-noisy": RemarkKind(
                severity="warning",
                meaning="Many points lie in no surface. Leaves among them are not found.",
                action="Filter the scan, or scan again from nearer.",
            ),
            "leaves-sparse-in-cloud": RemarkKind(
                severity="warning",
                meaning="Leaves have few points. Some are guessed, and others are not found.",
                action="Scan from nearer, or with a finer step.",
            ),
            "leaves-in-thinned-cloud": RemarkKind(
                severity="info",
                meaning=(
                    "The cloud is denser than its noise, or too large. Leaves are looked for in the mean of the points "
                    "of each cell."
                ),
                action="Nothing. `leaves.cloud.segmentation.max_points` sets how many points are kept.",
            ),
            "cloud-leaves-few": RemarkKind(
                severity="info",
                meaning="Too few leaves were found in the cloud alone. The plant's leaves are drawn.",
                action="Scan from nearer, or set `leaves.min_in_cloud` lower.",
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
            "leaves-on-stems-left-out": RemarkKind(
                severity="info",
                meaning="Leaves that were found are as slender as a stem, and lie along one. They are left out.",
                action="Nothing: they are parts of the stem.",
            ),
            "slivers-left-out": RemarkKind(
                severity="info",
                meaning=(
                    "Leaves that were found are narrower than most of the plant's, and duller in colour, as pieces of "
                    "stems are. They are left out; the remark has their places in the asset, in metres."
                ),
                action="Nothing: they are parts of stems.",
            ),
            "leaves-below-stems-left-out": RemarkKind(
                severity="info",
                meaning=(
                    "Leaves that were found lie below the foot of the stems and beside it, in another colour than the "
                    "plant's leaves. They are left out; the remark has their places in the asset, in metres."
                ),
                action="Nothing: they are soil, or parts of a stem.",
            ),
            "leaves-not-joined": RemarkKind(
                severity="info",
                meaning=(
                    "No stem leads to these leaves. Those more than two leaf lengths from stems and from leaves on "
                    "them are left out; the others are kept. The remark has their places in the asset, in metres."
                ),
                action="Look at the leaves at these places. Photographs between the others show more of the stems.",
            ),
            "leaves-beside-plant-left-out": RemarkKind(
                severity="info",
                meaning="Leaves lie far from the plant's points, as of another plant in the scan. They are left out.",
                action="Nothing. Crop neighbours away if they are joined to the plant.",
            ),
            "found-leaves-kept": RemarkKind(
                severity="info",
                meaning="Leaves that are probably right stay where they were found. Others are on the twigs.",
                action="Nothing, or set `foliage.kind` to have one kind alone.",
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
            "crown-leaf-plain": RemarkKind(
                severity="warning",
                meaning=(
                    "The picture of the average leaf cannot be used for the leaves of the crown, which are plain ones."
                ),
                action="Do what the remark asks for. Nothing else of the plant changes.",
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
                meaning="Black points have no colour. Each counts as a leaf if the nearest coloured points are leaves.",
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
                action="Correct it, and give it to `usdfoliage crown` as the mask.",
            ),
        },
    ),
    RemarkSection(
        title="Leaves of several lobes",
        kinds={
            "lobed-mask-of-alpha": RemarkKind(
                severity="info",
                meaning="The leaf's mask is the alpha channel of the scan.",
                action="Nothing.",
            ),
            "lobed-mask-of-colours": RemarkKind(
                severity="info",
                meaning="No mask is given. The leaf is what differs in colour from the paper or ground around it.",
                action="Look at the silhouette in the report. Give a mask if it is wrong.",
            ),
            "lobed-touching": RemarkKind(
                severity="warning",
                meaning="A leaf of the scan seems to be several leaves that touch each other.",
                action="Part them in a mask, or scan them again with room between them.",
            ),
            "lobed-low-contrast": RemarkKind(
                severity="warning",
                meaning="A leaf differs little in colour from its ground. Its silhouette is uncertain.",
                action="Look at the silhouette in the report. Give a mask if it is wrong.",
            ),
            "lobed-dust": RemarkKind(
                severity="info",
                meaning="Small pieces of the mask are left out.",
                action="Nothing, if they are dust. Otherwise connect them to the leaf in the mask.",
            ),
            "lobed-leaf-left-out": RemarkKind(
                severity="warning",
                meaning="One of several leaves has no model. The others are written.",
                action="Correct its part of the mask, or leave it out there.",
            ),
            "lobed-size-assumed": RemarkKind(
                severity="warning",
                meaning="The scale of the scan is not known. The leaf is given a height of 0.1 m.",
                action="Give the pixels an inch of the scan, or the width or the height of the leaf.",
            ),
            "lobed-at-border": RemarkKind(
                severity="warning",
                meaning="The leaf reaches the border of the scan, and is cut there.",
                action="Scan the whole leaf.",
            ),
            "lobed-holes": RemarkKind(
                severity="info",
                meaning="The mask has holes. The mesh goes on there, and the texture is transparent.",
                action="Nothing, if the leaf has holes. Otherwise fill them in the mask.",
            ),
            "lobed-faces-inexact": RemarkKind(
                severity="warning",
                meaning="The faces of the flat leaf leave parts of the mask, or go beyond it.",
                action="Look at the mesh in the report. Scan small or toothed leaves at a higher resolution.",
            ),
            "lobed-faces-folded": RemarkKind(
                severity="warning",
                meaning="Some faces of the flat leaf lie over their neighbours.",
                action="Look at the mesh in the report. Make narrow bays of the mask wider.",
            ),
        },
    ),
    RemarkSection(
        title="Trees out of one photograph",
        kinds={
            "strokes-proposed": RemarkKind(
                severity="info",
                meaning="No strokes are given. They are proposed, with how confident the proposal is.",
                action="Look at them in the report. Correct strokes.json in the asset's folder, and give it.",
            ),
            "strokes-uncertain": RemarkKind(
                severity="warning",
                meaning="No strokes are given, and the proposed ones have a confidence below 0.5.",
                action="Look at them in the report. Correct strokes.json in the asset's folder, and give it.",
            ),
            "foliage-improbable": RemarkKind(
                severity="warning",
                meaning="What was taken for leaves has little contrast from leaf to leaf and no colour of leaves, or "
                "edges along two directions, as a wall has.",
                action="Look at the leaves in the report. If they are none, draw the stroke around the tree.",
            ),
            "leaves-broad": RemarkKind(
                severity="info",
                meaning="No species and no leaf is given, and the tree has broad leaves. A photograph does not decide "
                "their form.",
                action="Name the species, or give a leaf: a picture of one, or an asset of leaves. A conifer needs one "
                "or the other.",
            ),
            "tree-without-leaves": RemarkKind(
                severity="info",
                meaning="The photograph shows twigs inside of the crown's stroke, and no leaves.",
                action="Ask for leaves if the tree shall have some.",
            ),
        },
    ),
    RemarkSection(
        title="Looks and bakes",
        kinds={
            "jitter-map-without-jitter": RemarkKind(
                severity="info",
                meaning="A jitter map is set while the amplitude is 0. It shows nothing.",
                action="Give an amplitude of the jitter too.",
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
                action="Bake the asset with nurbs as the source of the leaves.",
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
            "files-left-out": RemarkKind(
                severity="warning",
                meaning="The asset names files outside its folder, or files that are no pictures. They are not copied.",
                action="Put a picture into the asset's folder, name it there, and bake again.",
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
        title="Exports",
        kinds={
            "surface-not-refined": RemarkKind(
                severity="warning",
                meaning="A subdivision surface has too many faces to be refined. The export has its cage as polygons.",
                action="Choose fewer orders of branches in the asset's variant set branches, and export again.",
            ),
            "assembly-without-joints": RemarkKind(
                severity="info",
                meaning="A plant without branches becomes an assembly of static meshes. No wind moves it.",
                action="Nothing, or give the leaves branches with `usdfoliage branches`.",
            ),
            "leaf-shapes-repeated": RemarkKind(
                severity="info",
                meaning=(
                    "Each leaf has the shape of one of a few. The remark has how far these are from the leaves' own "
                    "shapes."
                ),
                action="Allow more shapes if leaves near the camera show it.",
            ),
            "colors-averaged": RemarkKind(
                severity="info",
                meaning=(
                    "The profile's applications read no colour of a single leaf. The material has the mean colour."
                ),
                action="Give the leaves a texture, or export with the profile standalone.",
            ),
        },
    ),
    RemarkSection(
        title="Builds",
        kinds={
            "part-failed": RemarkKind(
                severity="warning",
                meaning="A stage could not make its part, and the plant goes without it.",
                action="Read the text, which gives the reason.",
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
            "sway-without-branches": RemarkKind(
                severity="warning",
                meaning="A rig or a sway was asked for, and the plant has no branches whose joints could turn.",
                action="Set `branches.make` to `on`, or leave out the sway.",
            ),
            "growth-without-branches": RemarkKind(
                severity="warning",
                meaning="Growth was asked for, and the plant has no branches that could grow.",
                action="Set `branches.make` to `on`, or leave out the growth.",
            ),
            "variations-without-branches": RemarkKind(
                severity="warning",
                meaning=(
                    "Variations were asked for, and no branches were traced through a cloud that they could grow "
                    "through."
                ),
                action="Set `branches.make` to `on` and `branches.photographs` to `false`, or ask for no variations.",
            ),
            "variation-failed": RemarkKind(
                severity="warning",
                meaning="A variation of the plant could not be made; the plant and its other variations stand.",
                action="Do what the remark names, or ask for more variations.",
            ),
            "plant-leaves-guessed": RemarkKind(
                severity="warning",
                meaning=(
                    "Most leaves of the plant were not found but drawn from those that were, or most that were found "
                    "are wrong. The remark has the counts, and how small leaves are in the photographs."
                ),
                action="See [Single leaves](#single-leaves).",
            ),
            "thumbnail-missing": RemarkKind(
                severity="warning",
                meaning="The asset has no thumbnail and no cards, because the preview interpreter could not draw them.",
                action="Read the text, which names the cause. Run the build again.",
            ),
            "pictures-missing": RemarkKind(
                severity="warning",
                meaning="The report has no pictures of the plant, because the preview interpreter could not draw them.",
                action="Read the text, which names the cause. Run the build again.",
            ),
            "photographs-not-compared": RemarkKind(
                severity="warning",
                meaning="These photographs cannot be read, and the report does not compare the plant with them.",
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
        title="Forests",
        kinds={
            "terrain-without-crs": RemarkKind(
                severity="warning",
                meaning="The DEM states no coordinate system. Its lengths are taken for metres.",
                action="Look at the size of the terrain in the report. Give a DEM with a coordinate system.",
            ),
            "shot-without-unit": RemarkKind(
                severity="warning",
                meaning="The file of a shot states no metersPerUnit. USD takes its lengths for centimetres.",
                action="Look at the pictures of the shot. Author metersPerUnit in its file.",
            ),
            "terrain-height-unit": RemarkKind(
                severity="warning",
                meaning="The DEM states no unit of its heights, and its easting and northing are not in metres.",
                action="Look at the heights in the report. Convert the DEM to metres with `gdalwarp`.",
            ),
            "terrain-gridded": RemarkKind(
                severity="info",
                meaning="The DEM is a mesh or a cloud. Its heights are taken at the middles of square pixels.",
                action="Nothing, or give another spacing of the ground.",
            ),
            "terrain-unclassified": RemarkKind(
                severity="warning",
                meaning="The points of the DEM have no class for the ground. The ground was found by a filter, which "
                "takes plants and houses off.",
                action="Look at the ground in the report. Give the width of the widest house where parts of houses are "
                "left, or classify the points in another program.",
            ),
            "canopy-of-cloud": RemarkKind(
                severity="info",
                meaning="No canopy height is given. Plants are as high as the highest points of the cloud are above "
                "its ground.",
                action="Nothing, or give a raster of the canopy height.",
            ),
            "terrain-holes": RemarkKind(
                severity="info",
                meaning="The DEM has no height in some pixels. The ground is closed there, and no plant stands on it.",
                action="Nothing, or fill the holes of a raster with `gdal_fillnodata`.",
            ),
            "raster-covers-less": RemarkKind(
                severity="warning",
                meaning="A raster covers a part of the DEM only. Beyond it nothing is seen.",
                action="Give a larger raster, or cut the DEM with `gdalwarp -te`.",
            ),
            "trunks-unread": RemarkKind(
                severity="warning",
                meaning="Lines of the file of trunks do not begin with two finite numbers. They are left out.",
                action="Write easting and northing in the first two columns of each line.",
            ),
            "plants-left-out": RemarkKind(
                severity="info",
                meaning="Plants were seen or drawn, and not planted. The remark names the reason.",
                action="Change the rules of `plants.toml` or the vegetation where they are wrong.",
            ),
            "vegetation-found": RemarkKind(
                severity="info",
                meaning="Where trees, shrubs and grass are was found in the orthophoto and the canopy height.",
                action="Give a raster of vegetation where it is known. The forest can also have trees alone.",
            ),
            "class-without-plants": RemarkKind(
                severity="info",
                meaning="There is ground of a class for which `plants.toml` has no row. It stays empty.",
                action="Add a row of that kind.",
            ),
            "no-plants": RemarkKind(
                severity="warning",
                meaning="Nothing shows where plants stand: the forest is bare ground.",
                action="Give an orthophoto, a canopy height, a vegetation raster or trunks.",
            ),
        },
    ),
)

REMARK_KINDS: Mapping[str, RemarkKind] = {code: kind for section in SECTIONS for code, kind in section.kinds.items()}
