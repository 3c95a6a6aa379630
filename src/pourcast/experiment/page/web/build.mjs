// Bundles the page into dist/: nothing in it is fetched from another host.
import { build } from "esbuild";
import { copyFile, mkdir, readFile, rm, writeFile } from "node:fs/promises";
import { basename } from "node:path";

await rm("dist", { recursive: true, force: true });
const result = await build({
  entryPoints: { app: "src/main.ts" },
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  outdir: "dist/assets",
  entryNames: "[name]-[hash]",
  legalComments: "linked",
  metafile: true,
});
const named = (ending) =>
  Object.keys(result.metafile.outputs)
    .map((path) => basename(path))
    .find((name) => name.endsWith(ending));
const page = (await readFile("src/index.html", "utf8"))
  .replace("@SCRIPT@", `assets/${named(".js")}`)
  .replace("@STYLE@", `assets/${named(".css")}`);
// Whose code is in the bundle: their licences ask for it to be said.
const bundled = Object.keys(result.metafile.inputs)
  .map((path) => path.match(/^node_modules\/((@[^/]+\/)?[^/]+)/)?.[1])
  .filter(Boolean);
const credits = [];
for (const name of [...new Set(bundled)].sort()) {
  const about = JSON.parse(await readFile(`node_modules/${name}/package.json`, "utf8"));
  const author = about.author?.name ?? about.author ?? "its authors";
  credits.push(`${name} ${about.version}, ${about.license}, by ${author}`);
}
await mkdir("dist", { recursive: true });
await writeFile("dist/index.html", page);
await writeFile("dist/assets/credits.txt", `${credits.join("\n")}\n`);
await copyFile("src/icon.svg", "dist/assets/icon.svg");
