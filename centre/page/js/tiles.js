// SPDX-License-Identifier: GPL-3.0-or-later
// A map of one's own, a .pmtiles file beside the centre's: pictures, or the vector tiles of any scheme, drawn plainly.
import pmtiles from "../vendor/pmtiles.mjs";

const VECTOR = 1;
const protocol = new pmtiles.Protocol();
let known = null; // {type, layers, attribution} once it was read

// Colours by what a layer is called in the usual schemes (Protomaps, OpenMapTiles, Shortbread); all others are lines.
const FILLS = [[/^(earth|land)$/, "land"], [/water|ocean|lake/, "sea"], [/building/, "border"], [/landuse|landcover|land|park|natural/, "land"]];
const LINES = [[/transport|road|street|highway/, "muted"], [/water|river/, "sea"], [/bound|border|admin/, "border"], [/./, "border"]];

export async function readTiles(maplibre) {
  if (known) return known;
  maplibre.addProtocol("pmtiles", protocol.tile);
  const url = new URL("map/own.pmtiles", location.href.split("#")[0]).href;
  const file = new pmtiles.PMTiles(url);
  protocol.add(file);
  const [header, metadata] = await Promise.all([file.getHeader(), file.getMetadata()]);
  known = {
    source: { type: header.tileType === VECTOR ? "vector" : "raster", url: `pmtiles://${url}`, ...(header.tileType === VECTOR ? {} : { tileSize: 256 }) },
    names: header.tileType === VECTOR ? (metadata.vector_layers ?? []).map((each) => each.id) : null,
    // A text of a file of others may be markup, which the map would show as such.
    attribution: String(metadata.attribution ?? "").replace(/<[^>]*>/g, "").replace(/[<>&]/g, " ").slice(0, 200),
  };
  return known;
}

function first(table, name) {
  return table.find(([pattern]) => pattern.test(name))?.[1];
}

// Over the map of the world, below all that is ours.
export function tileLayers({ names }, colour, font) {
  if (!names) return [{ id: "own", type: "raster", source: "own" }];
  const order = (name) => FILLS.findIndex(([pattern]) => pattern.test(name));
  const filled = names.filter((name) => first(FILLS, name)).sort((a, b) => [0, 3, 1, 2].indexOf(order(a)) - [0, 3, 1, 2].indexOf(order(b)));
  const ours = (kind, name) => ({ id: `own-${kind}-${name}`, source: "own", "source-layer": name });
  return [
    ...filled.map((name) => ({ ...ours("fill", name), type: "fill", filter: ["==", ["geometry-type"], "Polygon"], paint: { "fill-color": colour(first(FILLS, name)) } })),
    ...names.map((name) => ({ ...ours("line", name), type: "line", filter: ["==", ["geometry-type"], "LineString"],
      paint: { "line-color": colour(first(LINES, name)), "line-width": ["interpolate", ["linear"], ["zoom"], 6, 0.4, 14, 2.2] } })),
    ...names.map((name) => ({ ...ours("name", name), type: "symbol", filter: ["all", ["==", ["geometry-type"], "Point"], ["has", "name"]],
      layout: { "text-font": font, "text-size": 12, "text-field": ["get", "name"] },
      paint: { "text-color": colour("muted"), "text-halo-color": colour("land"), "text-halo-width": 1 } })),
  ];
}
