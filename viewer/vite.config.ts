// One HTML file with everything in it; the license of three.js, which is in it too, stands at its top. The content
// security policy names the one script by its hash: no other is ever run, whatever the data hold.

import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { defineConfig, type Plugin } from "vite";
import { viteSingleFile } from "vite-plugin-singlefile";

function sealed(html: string): string {
  const scripts = [...html.matchAll(/<script type="module"[^>]*>([\s\S]*?)<\/script>/g)];
  const script = scripts[0]?.[1];
  if (!script || scripts.length !== 1) throw new Error(`expected one script in the page, found ${scripts.length}`);
  const hash = createHash("sha256").update(script).digest("base64");
  return html.replace("script-src 'unsafe-inline'", `script-src 'sha256-${hash}'`);
}

function finished(): Plugin {
  const text = readFileSync("node_modules/three/LICENSE", "utf8").trim().replaceAll("\r\n", "\n");
  const comment = `<!--
The page of quadlift's reports. Built from viewer/ by scripts/build_viewer.sh; do not edit it here.
Copyright (c) The quadlift developers, MIT or Apache 2.0. It contains three.js (https://threejs.org):

${text}
-->
`;
  return {
    name: "finished",
    enforce: "post",
    generateBundle: {
      // After the files have been put into the page.
      order: "post",
      handler(_options, bundle) {
        for (const file of Object.values(bundle)) {
          if (file.type === "asset" && file.fileName.endsWith(".html")) {
            // Lines that end in blanks would be changed by editors and by git.
            const html = String(file.source).replace(/^(<!doctype html>\n)/i, `$1${comment}`);
            file.source = sealed(html.replace(/[ \t]+$/gm, ""));
          }
        }
      },
    },
  };
}

export default defineConfig({
  plugins: [viteSingleFile({ removeViteModuleLoader: true }), finished()],
  build: { target: "es2022", modulePreload: false, reportCompressedSize: false },
});
