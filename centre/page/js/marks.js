// SPDX-License-Identifier: GPL-3.0-or-later
// The markers: one buffer, drawn by one call. Each is drawn where its station is, never between two places.
import { SHAPES } from "./dom.js";

const ORDER = ["good", "none", "old", "bad"]; // the worst lie on top
const FRAMED = 22, PLAIN = 19; // of a symbol, in pixels: what is not drawn costs nothing
const REACH = 14; // of a pointer, in pixels
const TILE = 512; // the world at zoom 0, in pixels
const NORTH = 85.0511; // where the map ends
const MANY = 2500; // fewer are drawn sooner than a sheet of them is copied
const MARGIN = 256; // of that sheet at each side of the view, in pixels: so far a drag needs no new one
// The parts of the world. An integer of 32 bits goes round as x does; y does not.
const ACROSS = 2 ** 32, DOWN = 2 ** 31;

const VERTEX = `#version 300 es
layout(location = 0) in uvec3 mark; // x, y, symbol
uniform uvec2 middle;
uniform mat4 matrix; // of worlds away from the middle
uniform float copy, ratio;
flat out float symbol, part; // of the cell that is drawn
void main() {
  vec2 away = vec2(ivec2(mark.xy - middle)) / vec2(${ACROSS}.0, ${DOWN}.0);
  gl_Position = matrix * vec4(away.x + copy, away.y, 0.0, 1.0);
  part = mark.z % 2u == 1u ? 1.0 : ${PLAIN}.0 / ${FRAMED}.0;
  gl_PointSize = ${FRAMED}.0 * part * ratio;
  symbol = float(mark.z);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D symbols;
flat in float symbol, part;
out vec4 colour;
void main() {
  vec2 at = 0.5 + (gl_PointCoord - 0.5) * part;
  colour = texture(symbols, vec2((at.x + symbol) / ${2 * ORDER.length}.0, at.y));
}`;
// All of the view, by a triangle around it, from the sheet.
const SHEET_VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;
const SHEET_FRAGMENT = `#version 300 es
precision highp float;
uniform highp sampler2D sheet;
uniform ivec2 shift;
out vec4 colour;
void main() {
  colour = texelFetch(sheet, ivec2(gl_FragCoord.xy) + shift, 0);
}`;

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

// A state's shape and colour, in units of half a pixel; a station that stays where it is has a frame.
function paint(pen, kind, framed) {
  if (framed) {
    pen.fillStyle = colour("panel");
    pen.strokeStyle = colour("text");
    pen.lineWidth = 3;
    pen.beginPath();
    pen.roundRect(3, 3, 2 * FRAMED - 6, 2 * FRAMED - 6, 8);
    pen.fill();
    pen.stroke();
  }
  const scale = framed ? 1.5 : 2;
  pen.translate(FRAMED - 8 * scale, FRAMED - 8 * scale);
  pen.scale(scale, scale);
  const path = new Path2D(SHAPES[kind]);
  pen.lineWidth = 2.4;
  pen.strokeStyle = colour("panel");
  if (!framed) pen.stroke(path);
  pen.fillStyle = colour(kind);
  pen.fill(path, "evenodd");
}

function picture(ratio) {
  const cell = Math.round(FRAMED * ratio);
  const canvas = new OffscreenCanvas(2 * ORDER.length * cell, cell);
  const pen = canvas.getContext("2d");
  const scale = cell / FRAMED / 2;
  ORDER.forEach((kind, number) => [false, true].forEach((framed) => {
    pen.setTransform(scale, 0, 0, scale, (2 * number + framed) * cell, 0);
    paint(pen, kind, framed);
  }));
  return canvas;
}

// Web Mercator, in parts of the world.
function parts([longitude, latitude]) {
  const north = (Math.min(NORTH, Math.max(-NORTH, latitude)) * Math.PI) / 180;
  return [Math.round((longitude / 360 + 0.5) * ACROSS), Math.round((0.5 - Math.asinh(Math.tan(north)) / (2 * Math.PI)) * DOWN)];
}

function program(gl, vertex, fragment, uniforms) {
  const shaders = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(shaders, shader);
    gl.deleteShader(shader);
  }
  gl.linkProgram(shaders);
  return { shaders, at: Object.fromEntries(uniforms.map((name) => [name, gl.getUniformLocation(shaders, name)])) };
}

// A pixel for a pixel: without a graphics processor a filter takes more time than all else of a marker.
function texture(gl) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return made;
}

// A custom layer of MapLibre.
export class Marks {
  id = "marks";
  type = "custom";
  places = []; // {id, kind, lngLat, fixed}, as they are drawn
  numbers = new Uint32Array(); // x, y, symbol of each
  tools = null; // of WebGL
  sheetView = null; // which the sheet was drawn for
  shift = null; // of the sheet in this frame, if it serves

  constructor(map) {
    this.map = map;
  }

  show(places) {
    this.places = ORDER.flatMap((kind) => places.filter((place) => place.kind === kind));
    const numbers = new Uint32Array(3 * this.places.length);
    this.places.forEach(({ kind, lngLat, fixed }, number) => {
      const [x, y] = parts(lngLat);
      numbers[3 * number] = x;
      numbers[3 * number + 1] = y;
      numbers[3 * number + 2] = 2 * ORDER.indexOf(kind) + Boolean(fixed);
    });
    if (numbers.length === this.numbers.length && numbers.every((each, at) => each === this.numbers[at])) return;
    this.numbers = numbers;
    this.fresh = true;
    this.sheetView = null;
    this.map.triggerRepaint();
  }

  // {place, distance} of those that are at most so many pixels from a place of the map, across and up.
  near(lngLat, across, up) {
    const world = TILE * 2 ** this.map.getZoom();
    const [x, y] = parts(lngLat);
    const found = [];
    this.places.forEach((place, number) => {
      const right = (((this.numbers[3 * number] - x) | 0) / ACROSS) * world;
      const down = ((this.numbers[3 * number + 1] - y) / DOWN) * world;
      if (Math.abs(right) <= across && Math.abs(down) <= up) found.push({ place, distance: Math.hypot(right, down) });
    });
    return found;
  }

  inSight() {
    const { clientWidth, clientHeight } = this.map.getContainer();
    return this.near(this.map.getCenter().toArray(), clientWidth / 2, clientHeight / 2).map(({ place }) => place);
  }

  // The nearest one, of those as near the topmost.
  under(lngLat) {
    return this.near(lngLat.toArray(), REACH, REACH).reduce((best, each) => (best && best.distance < each.distance ? best : each), null)?.place;
  }

  onAdd() {
    this.tools = null; // of another theme, or of a context that was lost
  }

  onRemove(_, gl) {
    const { vertices, buffer, symbols, sheet, frame, marks, copy } = this.tools ?? {};
    gl.deleteVertexArray(vertices);
    gl.deleteBuffer(buffer);
    gl.deleteTexture(symbols);
    gl.deleteTexture(sheet);
    gl.deleteFramebuffer(frame);
    gl.deleteProgram(marks?.shaders);
    gl.deleteProgram(copy?.shaders);
    this.tools = null;
  }

  // Here and not in onAdd: what prerender leaves of the state of WebGL, the map puts back.
  prepare(gl, ratio) {
    const made = { ratio, margin: Math.round(MARGIN * ratio), vertices: gl.createVertexArray(), buffer: gl.createBuffer(), frame: gl.createFramebuffer(),
      marks: program(gl, VERTEX, FRAGMENT, ["middle", "matrix", "copy", "ratio"]),
      copy: program(gl, SHEET_VERTEX, SHEET_FRAGMENT, ["shift"]) };
    gl.bindVertexArray(made.vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, made.buffer);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 3, gl.UNSIGNED_INT, 0, 0);
    made.symbols = texture(gl);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, true);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture(ratio));
    made.sheet = texture(gl);
    gl.bindFramebuffer(gl.FRAMEBUFFER, made.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, made.sheet, 0);
    this.fresh = true;
    this.sheetView = null;
    return made;
  }

  // Without a graphics processor 10 000 markers take as long as all else of the map. So a map that is dragged shows them from a
  // sheet, which is larger than the view, and is moved by whole pixels. A map that rests has each at its very pixel.
  prerender(gl, { defaultProjectionData }) {
    const ratio = this.map.getPixelRatio();
    if (this.tools?.ratio !== ratio) {
      this.onRemove(null, gl);
      this.tools = this.prepare(gl, ratio);
    }
    this.shift = null;
    if (this.places.length < MANY || !this.map.isMoving() || this.map.isZooming()) return;
    const view = this.view(gl);
    this.shift = this.moved(view);
    if (this.shift) return;
    this.drawSheet(gl, view, defaultProjectionData.mainMatrix);
    this.shift = [0, 0];
  }

  view(gl) {
    const [x, y] = parts(this.map.getCenter().toArray());
    return { x, y, zoom: this.map.getZoom(), width: gl.drawingBufferWidth, height: gl.drawingBufferHeight };
  }

  // How far the view has gone from that of the sheet, in pixels right and up; null where the sheet does not have it.
  moved(view) {
    if (!this.sheetView || ["zoom", "width", "height"].some((name) => view[name] !== this.sheetView[name])) return null;
    const world = TILE * 2 ** view.zoom * this.tools.ratio;
    const way = [((view.x - this.sheetView.x) | 0) / ACROSS, (this.sheetView.y - view.y) / DOWN];
    const shift = way.map((part) => Math.round(part * world));
    return shift.some((pixels) => Math.abs(pixels) > this.tools.margin) ? null : shift;
  }

  drawSheet(gl, view, matrix) {
    const { sheet, frame, margin } = this.tools;
    const [width, height] = [view.width + 2 * margin, view.height + 2 * margin];
    gl.bindTexture(gl.TEXTURE_2D, sheet);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    const larger = Array.from(matrix, (each, at) => each * [view.width / width, view.height / height, 1, 1][at % 4]);
    this.draw(gl, { ...view, width, height }, larger);
    this.sheetView = view;
  }

  draw(gl, { x, y, zoom, width }, from) {
    const { ratio, vertices, buffer, symbols, marks: { shaders, at } } = this.tools;
    // In numbers of 64 bits: those of 32 do not tell places of a street apart.
    const matrix = Float32Array.from(from);
    for (let row = 0; row < 4; row++) matrix[12 + row] = (from[row] * x) / ACROSS + (from[4 + row] * y) / DOWN + from[12 + row];
    gl.useProgram(shaders);
    gl.bindVertexArray(vertices);
    gl.bindTexture(gl.TEXTURE_2D, symbols);
    if (this.fresh) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, this.numbers, gl.DYNAMIC_DRAW);
      this.fresh = false;
    }
    gl.uniform2ui(at.middle, x, y);
    gl.uniformMatrix4fv(at.matrix, false, matrix);
    gl.uniform1f(at.ratio, ratio);
    // A map that is wider than the world shows it again at both sides.
    const copies = Math.max(0, Math.ceil(width / ratio / (TILE * 2 ** zoom) / 2 - 0.5));
    for (let copy = -copies; copy <= copies; copy++) {
      gl.uniform1f(at.copy, copy);
      gl.drawArrays(gl.POINTS, 0, this.places.length);
    }
  }

  render(gl, { defaultProjectionData }) {
    if (this.shift) this.copySheet(gl);
    else this.draw(gl, this.view(gl), defaultProjectionData.mainMatrix);
  }

  copySheet(gl) {
    const { sheet, margin, copy: { shaders, at } } = this.tools;
    gl.useProgram(shaders);
    gl.bindVertexArray(null);
    gl.bindTexture(gl.TEXTURE_2D, sheet);
    gl.uniform2iv(at.shift, this.shift.map((pixels) => margin + pixels));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}
