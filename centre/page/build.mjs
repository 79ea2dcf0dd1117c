// SPDX-License-Identifier: GPL-3.0-or-later
// node build.mjs PACKAGES OUT: the page as it is served: our files, what is taken from the packages, the base map.
import { cp, mkdir, readFile, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const [packages, out] = process.argv.slice(2).map((path) => resolve(path));
const here = dirname(fileURLToPath(import.meta.url));
const require = createRequire(pathToFileURL(join(packages, "..", "build.mjs")));
const topojson = require("topojson-client");
const DIGITS = 1e4; // 11 m: the map's own accuracy is far less

const TAKEN = {
  "maplibre-gl/dist/maplibre-gl.mjs": "maplibre-gl.mjs",
  "maplibre-gl/dist/maplibre-gl-worker.mjs": "maplibre-gl-worker.mjs",
  "maplibre-gl/dist/maplibre-gl.css": "maplibre-gl.css",
  "maplibre-gl/LICENSE.txt": "maplibre-gl.LICENSE.txt",
  "dompurify/dist/purify.es.mjs": "purify.mjs",
  "dompurify/LICENSE": "purify.LICENSE.txt",
  "uplot/dist/uPlot.esm.js": "uplot.mjs",
  "uplot/dist/uPlot.min.css": "uplot.css",
  "uplot/LICENSE": "uplot.LICENSE.txt",
};

// A script of others that only sets a variable becomes a module.
async function module(name, file, variable) {
  const { version, license } = JSON.parse(await readFile(join(packages, name, "package.json"), "utf8"));
  const script = (await readFile(join(packages, name, file), "utf8")).replace(/\/\/# sourceMappingURL=.*/, "");
  await writeFile(join(out, "vendor", `${name}.mjs`), `/* ${name} ${version}, ${license} */\n${script}\nexport default ${variable};\n`);
}

function rounded(part) {
  return typeof part === "number" ? Math.round(part * DIGITS) / DIGITS : part.map(rounded);
}

// A line over 180 degrees goes on beyond it; else it would cross the whole map the other way.
function unwrapped(line) {
  let turn = 0;
  return line.map(([x, y], number) => {
    if (number) {
      const step = x - line[number - 1][0];
      if (Math.abs(step) > 180) turn -= 360 * Math.sign(step);
    }
    return [x + turn, y];
  });
}

// A ring around a pole, which the projection does not show, is closed there.
function ring(line) {
  const way = unwrapped(line);
  const [begin, end] = [way[0], way.at(-1)];
  if (Math.abs(end[0] - begin[0]) < 180) return way;
  const pole = 85.05 * Math.sign(begin[1]);
  return [...way, [end[0], pole], [begin[0], pole], begin];
}

const UNWRAPPED = {
  MultiLineString: (lines) => lines.map(unwrapped),
  Polygon: (rings) => rings.map(ring),
  MultiPolygon: (polygons) => polygons.map((rings) => rings.map(ring)),
  Point: (place) => place,
};

function write(name, collection) {
  for (const { geometry } of collection.features) geometry.coordinates = rounded(UNWRAPPED[geometry.type](geometry.coordinates));
  return writeFile(join(out, "map", name), JSON.stringify(collection));
}

// A ring's first and last point are one; the largest ring tells where a name stands.
function middle(geometry) {
  const polygons = geometry.type === "Polygon" ? [geometry.coordinates] : geometry.coordinates;
  const largest = polygons.map((polygon) => unwrapped(polygon[0])).sort((a, b) => b.length - a.length)[0];
  let area = 0, x = 0, y = 0;
  for (let i = 0; i + 1 < largest.length; i++) {
    const cross = largest[i][0] * largest[i + 1][1] - largest[i + 1][0] * largest[i][1];
    area += cross;
    x += (largest[i][0] + largest[i + 1][0]) * cross;
    y += (largest[i][1] + largest[i + 1][1]) * cross;
  }
  return area ? [x / (3 * area), y / (3 * area)] : largest[0];
}

const world = JSON.parse(await readFile(join(packages, "world-atlas/countries-50m.json"), "utf8"));
const countries = world.objects.countries;
const names = topojson.feature(world, countries).features.filter((each) => each.geometry).map((each) => ({
  type: "Feature",
  properties: { name: each.properties.name },
  geometry: { type: "Point", coordinates: middle(each.geometry) },
}));
const borders = topojson.mesh(world, countries, (a, b) => a !== b);
const land = topojson.feature(world, world.objects.land);
const landFeatures = land.type === "FeatureCollection" ? land : { type: "FeatureCollection", features: [land] };

await mkdir(join(out, "map"), { recursive: true });
await mkdir(join(out, "vendor"), { recursive: true });
await Promise.all([
  write("land.json", landFeatures),
  write("borders.json", { type: "FeatureCollection", features: [{ type: "Feature", properties: {}, geometry: borders }] }),
  write("names.json", { type: "FeatureCollection", features: names }),
  module("pmtiles", "dist/pmtiles.js", "pmtiles"),
  ...Object.entries(TAKEN).map(([from, to]) => cp(join(packages, from), join(out, "vendor", to))),
  ...["index.html", "style.css", "icon.svg", "js", "lang"].map((name) => cp(join(here, name), join(out, name), { recursive: true })),
]);
