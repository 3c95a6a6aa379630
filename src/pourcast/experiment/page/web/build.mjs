// Bundles the page into dist/: nothing in it is fetched from another host.
import { build } from "esbuild";
import { copyFile, mkdir, readFile, rm, writeFile } from "node:fs/promises";
import { basename } from "node:path";

/** Bundles one entry; returns what it is made of, and its files' names by their endings. */
async function bundle(name, source, target) {
  const { metafile } = await build({
    entryPoints: { [name]: source },
    bundle: true,
    minify: true,
    format: "iife",
    target,
    outdir: "dist/assets",
    entryNames: "[name]-[hash]",
    legalComments: "linked",
    metafile: true,
  });
  const outputs = Object.keys(metafile.outputs).map((path) => basename(path));
  return { inputs: metafile.inputs, named: (ending) => outputs.find((output) => output.endsWith(ending)) };
}

// The oldest browsers that are served, "safari >= 14", as esbuild writes them: "safari14".
const { browserslist } = JSON.parse(await readFile("package.json", "utf8"));
const oldest = browserslist.map((one) => one.replace("ios_saf", "ios").replace(" >= ", ""));

await rm("dist", { recursive: true, force: true });
const app = await bundle("app", "src/main.ts", oldest);
const start = await bundle("start", "src/start.ts", "es5");
const page = (await readFile("src/index.html", "utf8"))
  .replace("@SCRIPT@", `assets/${app.named(".js")}`)
  .replace("@STYLE@", `assets/${app.named(".css")}`)
  .replace("@START@", `assets/${start.named(".js")}`);
// Whose code is in the bundle: their licences ask for it to be said.
const bundled = Object.keys(app.inputs)
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
