// Bundle the viewer into one file, with the licences of what is in it, and the studio around it into another, which finds
// the viewer as `cascadenormViewer`. `node build.mjs FOLDER` writes to another place.

import { build } from "esbuild";
import { readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const licences = ["three", "three-mesh-bvh"].map((name) => {
  const { version } = JSON.parse(readFileSync(join(here, "node_modules", name, "package.json"), "utf8"));
  const text = readFileSync(join(here, "node_modules", name, "LICENSE"), "utf8").trim();
  return `${name} ${version}\n\n${text}`;
});

const out = process.argv[2] ?? join(here, "..", "cascadenorm");
const options = {
  absWorkingDir: here,
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "ascii",
  legalComments: "none",
};

await build({
  ...options,
  entryPoints: ["src/main.ts"],
  outfile: join(out, "reports", "viewer.js"),
  globalName: "cascadenormViewer",
  banner: { js: `/*!\nThis file contains:\n\n${licences.join("\n\n")}\n*/` },
});
await build({ ...options, entryPoints: ["src/studio/main.ts"], outfile: join(out, "studio", "studio.js") });
