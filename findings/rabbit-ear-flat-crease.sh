#!/bin/sh
# Guess: in a FOLD file the angle decides: a crease with edges_foldAngle 0 stays flat when the graph is
#   folded. populate(), which fills in the arrays that are missing, changes no shape.
# Version: rabbit-ear 0.9.32 (npm), Node.js 18 or later.
# Behaviour: without edges_assignment, populate() marks each edge with angle 0 as "U" (unassigned), rims
#   included. Then makeVerticesCoordsFolded turns a "U" by 180 degrees whatever its angle is: a row of three
#   squares with one bend of 30 degrees and one flat crease is folded over onto itself, without a message. "U"
#   with 45 degrees is folded flat too. The same angles without any assignment, or with "F", are right.
# What to do: write edges_assignment in full, "F" for a fold that is flat and "B" for rims.
# Seen:
#   angles alone             last point 2.732051 0 1
#   angles, then populate()  last point 1 0 0 (assignments UUUUUUUVUU)
#   "F" and "B" written      last point 2.732051 0 1
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
npm init -y > /dev/null
npm install --silent --no-audit --no-fund rabbit-ear@0.9.32
cat > see.mjs <<'E'
import ear from "rabbit-ear";

// squares [0, 1], [1, 2], [2, 3] in a row: the crease at x = 1 is bent by 30 degrees, the one at x = 2 is flat
const strip = () => ({
  vertices_coords: [[0, 0], [1, 0], [2, 0], [3, 0], [0, 1], [1, 1], [2, 1], [3, 1]],
  edges_vertices: [[0, 1], [1, 2], [2, 3], [4, 5], [5, 6], [6, 7], [0, 4], [1, 5], [2, 6], [3, 7]],
  edges_foldAngle: [0, 0, 0, 0, 0, 0, 0, 30, 0, 0],
  faces_vertices: [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6]],
});
const last = (graph) =>
  ear.graph.makeVerticesCoordsFolded(graph, [0])[3].map((x) => Number(x.toFixed(6))).join(" ");

const filled = ear.graph.populate(strip());
const written = { ...strip(), edges_assignment: [..."BBBBBBBVFB"] };
const seen = [last(strip()), last(filled), last(written)];
console.log(`angles alone             last point ${seen[0]}`);
console.log(`angles, then populate()  last point ${seen[1]} (assignments ${filled.edges_assignment.join("")})`);
console.log(`"F" and "B" written      last point ${seen[2]}`);
if (seen.join("; ") !== "2.732051 0 1; 1 0 0; 2.732051 0 1") {
  console.log("changed: not as recorded");
  process.exit(1);
}
E
node see.mjs
