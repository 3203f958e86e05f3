// What the glTF validator says of a file, as one JSON document on standard output.
const fs = require("fs");
const validator = require("gltf-validator");

validator
  .validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])), { format: "glb" })
  .then((report) => console.log(JSON.stringify(report)));
