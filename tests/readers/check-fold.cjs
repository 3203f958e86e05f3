// What FOLD's own library makes of a file: its faces, creases and lengths. One JSON document on standard output.
const fs = require("fs");
const FOLD = require("fold");

const key = JSON.parse(fs.readFileSync(process.argv[2], "utf-8"));
// The library has no notion of frames: what frame 1 inherits is put together here, as the specification says.
const own = Object.fromEntries(Object.entries(key).filter(([name]) => !name.startsWith("file_")));
const space = Object.assign({}, own, key.file_frames[0]);

// Faces found from vertices and edges of the flat strip alone, counterclockwise.
const flat = FOLD.convert.deepCopy({ vertices_coords: key.vertices_coords, edges_vertices: key.edges_vertices });
FOLD.convert.edges_vertices_to_faces_vertices_edges(flat);

// A planar graph has no crossings to be cut at.
const cut = FOLD.convert.deepCopy({ vertices_coords: key.vertices_coords, edges_vertices: key.edges_vertices });
const changed = FOLD.filter.subdivideCrossingEdges_vertices(cut, FOLD.geom.EPS);

// Edges found from faces alone.
const mesh = { faces_vertices: FOLD.convert.deepCopy(key.faces_vertices) };
FOLD.convert.faces_vertices_to_edges(mesh);

const ends = (frame, edge) => frame.edges_vertices[edge].map((v) => frame.vertices_coords[v]);
const lengths = (frame) => frame.edges_vertices.map((_, edge) => FOLD.geom.dist(...ends(frame, edge)));
const normals = (frame) =>
  frame.faces_vertices.map((face) => FOLD.geom.polygonNormal(face.map((v) => frame.vertices_coords[v])));

// Fold angles in space, by the library's normals: positive where the left face's normal leans over the right face.
const facing = FOLD.convert.deepCopy(space);
FOLD.convert.faces_vertices_to_faces_edges(facing);
const faces = normals(space);
const angles = space.edges_vertices.map((_, edge) => {
  const sides = facing.faces_edges.flatMap((edges, face) => (edges.includes(edge) ? [face] : []));
  if (sides.length < 2) return 0;
  const [one, other] = sides;
  const away = FOLD.geom.sub(
    FOLD.geom.centroid(space.faces_vertices[other].map((v) => space.vertices_coords[v])),
    ends(space, edge)[0],
  );
  const size = FOLD.geom.ang(faces[one], faces[other]);
  return ((FOLD.geom.dot(faces[one], away) > 0 ? 1 : -1) * size * 180) / Math.PI;
});

console.log(
  JSON.stringify({
    faces: flat.faces_vertices,
    orientations: key.faces_vertices.map((face) => FOLD.geom.polygonOrientation(face.map((v) => key.vertices_coords[v]))),
    crossings: changed.length,
    edges: [cut.edges_vertices.length, mesh.edges_vertices.length],
    boundary: mesh.edges_assignment.filter((letter) => letter === "B").length,
    mountains: FOLD.filter.mountainEdges(key).length,
    valleys: FOLD.filter.valleyEdges(key).length,
    borders: FOLD.filter.boundaryEdges(key).length,
    lengths: [lengths(key), lengths(space)],
    angles,
    converted: FOLD.convert.convertTo(key, ".opx").length,
  }),
);
