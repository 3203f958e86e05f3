#!/bin/sh
# Guess: math.eigs of a symmetric matrix of 2 x 2 is right to rounding, whatever the unit of the entries: its tolerance
#   is config.relTol, a relative one.
# Version: mathjs 15.2.0 (npm), Node.js 18 or later.
# Behaviour: the sweeps stop once the largest number off the diagonal is below 1e-12 / n, however small the diagonal is.
#   The second moments of area of a strip 5 mm wide and 0.1 mm thick, in m^4, are below that: what comes back is the
#   diagonal in the frame given, and the axes of that frame. The lesser moment is 625 times too large. The option
#   `precision`, of which the manual says that it tells how small an entry counts as zero, does not help: the angle of a
#   sweep is 45 degrees wherever two numbers on the diagonal differ by less than 1e-12. There is no message.
# What to do: scale the matrix to numbers near 1, and the eigenvalues back.
# Seen (principal moments in m^4 of a strip whose section stands at 30 degrees):
#   strip                  in m^4                in mm^4, turned into m^4  exact
#   10 mm x 0.1 mm         8.333e-16, 8.333e-12  8.333e-16, 8.333e-12      8.333e-16, 8.333e-12
#   5 mm x 0.1 mm          2.607e-13, 7.814e-13  4.167e-16, 1.042e-12      4.167e-16, 1.042e-12
#   ... precision: 1e-30   7.017e-14, 9.719e-13  4.167e-16, 1.042e-12      4.167e-16, 1.042e-12
#   3 mm x 0.03 mm         1.688e-14, 5.063e-14  6.750e-18, 6.750e-14      6.750e-18, 6.750e-14
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
npm init -y > /dev/null
npm install --silent --no-audit --no-fund mathjs@15.2.0
cat > see.mjs <<'E'
import { all, create } from "mathjs";

const math = create(all);
const [c, s] = [Math.cos(Math.PI / 6), Math.sin(Math.PI / 6)];
const near = (a, b) => a.every((x, i) => Math.abs(x / b[i] - 1) < 1e-6);
const text = (values) => values.map((x) => x.toExponential(3)).join(", ");
console.log("strip                  in m^4                in mm^4, turned into m^4  exact");
const seen = [];
for (const [name, width, thickness, options] of [
  ["10 mm x 0.1 mm", 0.01, 1e-4, {}],
  ["5 mm x 0.1 mm", 0.005, 1e-4, {}],
  ["... precision: 1e-30", 0.005, 1e-4, { precision: 1e-30 }],
  ["3 mm x 0.03 mm", 0.003, 3e-5, {}],
]) {
  const exact = [(width * thickness ** 3) / 12, (thickness * width ** 3) / 12];
  const off = (exact[0] - exact[1]) * c * s;
  const moments = [
    [exact[0] * c * c + exact[1] * s * s, off],
    [off, exact[0] * s * s + exact[1] * c * c],
  ];
  const given = math.eigs(moments, options).values;
  const scaled = math.eigs(math.multiply(moments, 1e12), options).values.map((x) => x * 1e-12);
  console.log(`${name.padEnd(21)}  ${text(given)}  ${text(scaled)}      ${text(exact)}`);
  seen.push([near(given, exact), given[0] / exact[0] > 100, near(scaled, exact)]);
}
const wanted = [[true, false, true], ...Array(3).fill([false, true, true])];
if (JSON.stringify(seen) !== JSON.stringify(wanted)) {
  console.log("changed: not as recorded");
  process.exit(1);
}
E
node see.mjs
