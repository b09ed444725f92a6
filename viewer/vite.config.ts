// One HTML file with everything in it; the licence of three.js, which is in it too, stands at its top.

import { readFileSync } from "node:fs";
import { defineConfig, type Plugin } from "vite";
import { viteSingleFile } from "vite-plugin-singlefile";

function licences(): Plugin {
  const text = readFileSync("node_modules/three/LICENSE", "utf8").trim().replaceAll("\r\n", "\n");
  const comment = `<!--
The page of quadlift's reports. Built from viewer/ by scripts/build_viewer.sh; do not edit it here.
Copyright (c) The quadlift developers, MIT or Apache 2.0. It contains three.js (https://threejs.org):

${text}
-->
`;
  return {
    name: "licences",
    enforce: "post",
    generateBundle(_options, bundle) {
      for (const file of Object.values(bundle)) {
        if (file.type === "asset" && file.fileName.endsWith(".html")) {
          // Lines that end in blanks would be changed by editors and by git.
          const html = String(file.source).replace(/^(<!doctype html>\n)/i, `$1${comment}`);
          file.source = html.replace(/[ \t]+$/gm, "");
        }
      }
    },
  };
}

export default defineConfig({
  plugins: [viteSingleFile({ removeViteModuleLoader: true }), licences()],
  build: { target: "es2022", modulePreload: false, reportCompressedSize: false },
});
