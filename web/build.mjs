// Builds vve_sumo/view/web/world.min.js from src/ and three.js, with the hash and the licence beside it.
// The same sources and the same package-lock.json give the same bytes. `node build.mjs FOLDER` writes into another folder.

import { createHash } from "node:crypto";
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const out = resolve(process.argv[2] ?? join(here, "../vve_sumo/view/web"));
const NAME = "world.min.js";

const glsl = {
  name: "shaders without comments and indentation",
  setup(building) {
    building.onLoad({ filter: /src[\\/].*\.js$/ }, ({ path }) => {
      const text = readFileSync(path, "utf8");
      const shrunk = text.replace(/(\/\* glsl \*\/ `)([^`]*)(`)/g, (_, head, code, tail) => {
        return head + code.replace(/\/\/.*$/gm, "").replace(/^\s+/gm, "") + tail;
      });
      return { contents: shrunk, loader: "js" };
    });
  },
};

mkdirSync(out, { recursive: true });
await build({
  absWorkingDir: here,
  entryPoints: ["src/world.js"],
  bundle: true,
  format: "esm",
  minify: true,
  target: ["es2022"],
  legalComments: "none",
  banner: { js: "// vve-sumo, Apache-2.0; with parts of three.js, MIT: three.LICENSE.txt. Built by web/build.mjs." },
  plugins: [glsl],
  outfile: join(out, NAME),
  logLevel: "warning",
});
const hash = createHash("sha256").update(readFileSync(join(out, NAME))).digest("hex");
writeFileSync(join(out, `${NAME}.sha256`), `${hash}  ${NAME}\n`);
copyFileSync(join(here, "node_modules/three/LICENSE"), join(out, "three.LICENSE.txt"));
