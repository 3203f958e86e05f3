#!/bin/sh
# Draws the pictures of the documentation from the configs: draw.sh RIBBON, in the project's folder.
set -eu
ribbon=$1
to=docs/gallery
for config in mobius-pi mobius-pi-contact mobius-3pi everted-cylinder-160 everted-branch-40 ring; do
    "$ribbon" -q solve "configs/$config.yaml" > /dev/null
done
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
