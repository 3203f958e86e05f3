#!/bin/sh
# Draws the pictures of the documentation from the configs: draw.sh RIBBON, in the project's folder. RIBBON has a
# `python` with matplotlib beside it.
set -eu
ribbon=$1
to=docs/gallery
for config in mobius-pi mobius-pi-contact mobius-3pi everted-cylinder-160 everted-branch-40 cylinder ring; do
    "$ribbon" -q solve "configs/$config.yaml" > /dev/null
done
"$(dirname "$ribbon")/python" -m paper -q everted-cylinder-40 everted-moebius-a-160 everted-moebius-b-160 > /dev/null
draw() {
    picture=$1
    shift
    "$ribbon" -q plot "$@" -o "$to/$picture.png" --overwrite
}
draw family mobius-pi family
draw three-pi mobius-3pi@b=0.65,N=240 shape
draw everted everted-cylinder-160@b=0.03,N=160 shape --view 35,25
draw geometry mobius-pi geometry
draw multipliers mobius-3pi@b=0.65,N=240 multipliers
draw spectrum ring spectrum
draw convergence mobius-pi convergence
draw branch mobius-pi-contact branch
draw mode everted-branch-40@b=0.2,N=40 mode
draw branches everted-branch-40 branch
draw pattern mobius-pi@b=0.5,N=50 pattern
# The recipes of docs/recipes.md stage by stage, with few colours: they need no more, and the files are small.
small() {
    "$(dirname "$ribbon")/python" - "$to/$1.png" << 'END'
import sys
from PIL import Image

Image.open(sys.argv[1]).convert("RGB").quantize(64).save(sys.argv[1], optimize=True)
END
}
row() {
    picture=$1 run=$2 first=$3
    shift 3
    for label in "$@"; do
        set -- "$@" --with "$run:$label"
        shift
    done
    draw "$picture" "$run:$first" shape "$@"
    small "$picture"
}
row recipe-cylinder cylinder 3 6
row recipe-twist mobius-pi 17 33 50 52
row recipe-schoenke mobius-3pi 1 2 35
row recipe-eversion everted-cylinder-40 1 14 26 27 29 31 33
draw everted-moebius mobius-pi@b=0.1,N=200 shape --with everted-moebius-a-160:1 --with everted-moebius-b-160:1
small everted-moebius
# The strips of docs/strips-gallery.md.
for config in buckled sheared twisted twisted-beyond hanging straightened cantilever; do
    "$ribbon" -q solve "configs/strips/$config.yaml" > /dev/null
done
draw strip-buckled strip-buckled family
draw strip-sheared "strip-sheared@b=0.05,span=0.75,shear=0" shape --with "strip-sheared@b=0.05,shear=0.2" --with "strip-sheared@b=0.05,shear=0.25" \
    --with "strip-sheared@b=0.05,shear=0.4" --with "strip-sheared@b=0.02,shear=0.4" --with "strip-sheared@b=0.1,shear=0.4"
draw strip-twisted "strip-twisted:1" shape --with "strip-twisted@b=0.05,twist=1.57079632679" --with "strip-twisted@b=0.05,twist=3.14159265359" \
    --with strip-twisted-beyond:1 --with strip-twisted-beyond:7
draw strip-hanging strip-hanging:1 shape --with strip-hanging:7 --with strip-hanging:13
draw strip-straightened strip-straightened family
draw strip-cantilever strip-cantilever:1 shape --with strip-cantilever@end_force_y=-0.5,end_force_z=0 --with strip-cantilever@end_force_z=0.1
"$ribbon" -q solve configs/strips/shear-branches.yaml > /dev/null
draw bifurcation strip-shear-branches branch
for picture in bifurcation strip-buckled strip-sheared strip-twisted strip-hanging strip-straightened strip-cantilever; do
    small "$picture"
done
# The bands of docs/contact-gallery.md.
for config in pi-400 figure-eight 3pi 5pi 7pi; do
    # 3: some widths are undecided
    "$ribbon" -q solve "configs/contact/$config.yaml" > /dev/null || [ $? -eq 3 ]
done
draw contact-pi contact-pi-400@b=1.5 shape --with contact-pi-400@b=1.66 --with contact-pi-400@b=1.78
draw contact-pi-map contact-pi-400@b=1.66 contacts
draw contact-pi-branch contact-pi-400 branch
draw contact-figure-eight contact-figure-eight@b=0.05 shape --with contact-figure-eight@b=0.3 --with contact-figure-eight@b=0.5 \
    --with contact-figure-eight@b=0.8 --with contact-figure-eight@b=1.1 --with contact-figure-eight@b=1.4
draw contact-figure-eight-branch contact-figure-eight branch
draw contact-3pi contact-3pi@b=0.6 shape --with contact-3pi@b=0.67 --with contact-3pi@b=0.8 --with contact-3pi@b=1
draw contact-5pi contact-5pi@b=0.1 shape --with contact-5pi@b=0.3 --with contact-5pi@b=0.5
draw contact-7pi contact-7pi@b=0.1 shape --with contact-7pi@b=0.2 --with contact-7pi@b=0.25
for picture in contact-pi contact-pi-map contact-pi-branch contact-figure-eight contact-figure-eight-branch contact-3pi contact-5pi contact-7pi; do
    small "$picture"
done
# The pictures of docs/tutorial.md, from its config.
folder=$(mktemp -d)
sed -n '/^# pi.yaml$/,/^```$/p' docs/tutorial.md | grep -v '^```' > "$folder/pi.yaml"
"$ribbon" -q solve "$folder/pi.yaml" > /dev/null
"$ribbon" -q solve configs/paper/mobius-pi-second-minimum.yaml > /dev/null
"$ribbon" -q continue mobius-pi-second-minimum@b=0.1,N=50 --to 0.12 --back-to 0.09 --arclength --max-step 0.3 > /dev/null
draw tutorial-shape pi@b=0.4,N=96 shape
draw tutorial-mode pi@b=0.4,N=96 mode
draw tutorial-branch mobius-pi-second-minimum branch
draw tutorial-pattern pi@b=0.4,N=48 pattern
for picture in tutorial-shape tutorial-mode tutorial-branch tutorial-pattern; do
    small "$picture"
done
rm -r "$folder"
