// SPDX-License-Identifier: GPL-3.0-or-later
// Zoom and pan of a drawing: wheel, fingers, buttons and keys. At rest its view box says what is seen. While one
// finger drags, a picture of it is moved as a whole, and not drawn anew for each frame.

const STEP = 1.25, MOST = 40, MOVED_PX = 5;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class Zoom {
  // `host` is what takes the pointer, `root` the svg.
  constructor(host, root) {
    this.host = host;
    this.root = root;
    const { x, y, width, height } = root.viewBox.baseVal;
    this.whole = { x, y, width, height };
    this.view = this.drawn = { ...this.whole }; // what is seen, and what is drawn so
    this.pointers = new Map();
    this.dragged = false; // the click that follows is none
    const on = (name, handler, options) => host.addEventListener(name, handler, { ...options, signal: this.ending.signal });
    this.ending = new AbortController();
    on("wheel", (event) => this.wheel(event), { passive: false });
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) on(name, (event) => this.up(event));
    on("click", (event) => this.dragged && event.stopPropagation(), { capture: true });
  }

  end() {
    this.ending.abort();
  }

  fit() {
    this.show({ ...this.whole });
  }

  // Units of the drawing for a pixel; and where the drawing begins, which is in the middle of its host.
  scale() {
    const box = this.host.getBoundingClientRect();
    const unit = Math.max(this.view.width / box.width, this.view.height / box.height) || 1;
    const { x, y, width, height } = this.view;
    return { unit, left: x - (box.width * unit - width) / 2 - box.left * unit, top: y - (box.height * unit - height) / 2 - box.top * unit };
  }

  at(clientX, clientY) {
    const { unit, left, top } = this.scale();
    return [left + clientX * unit, top + clientY * unit];
  }

  // Nothing is lost from sight: a part of the drawing stays in it.
  look(view) {
    const { whole } = this;
    view.width = Math.min(Math.max(view.width, whole.width / MOST), whole.width * 2);
    view.height = (view.width * whole.height) / whole.width;
    view.x = Math.min(Math.max(view.x, whole.x - view.width * 0.75), whole.x + whole.width - view.width * 0.25);
    view.y = Math.min(Math.max(view.y, whole.y - view.height * 0.75), whole.y + whole.height - view.height * 0.25);
    this.view = view;
  }

  show(view) {
    this.look(view);
    this.draw();
  }

  draw() {
    const { x, y, width, height } = this.view;
    this.root.setAttribute("viewBox", `${x} ${y} ${width} ${height}`);
    this.root.classList.remove("dragged");
    this.root.style.removeProperty("transform");
    this.drawn = this.view;
  }

  // What is drawn, at another place.
  slide(x, y, unit) {
    this.look({ ...this.view, x: this.view.x + x, y: this.view.y + y });
    const { view, drawn } = this;
    this.root.classList.add("dragged");
    this.root.style.setProperty("transform", `translate(${(drawn.x - view.x) / unit}px, ${(drawn.y - view.y) / unit}px)`);
  }

  by(factor, at = [this.view.x + this.view.width / 2, this.view.y + this.view.height / 2]) {
    const { x, y, width, height } = this.view;
    const wide = Math.min(Math.max(width / factor, this.whole.width / MOST), this.whole.width * 2);
    const share = wide / width;
    this.show({ x: at[0] - (at[0] - x) * share, y: at[1] - (at[1] - y) * share, width: wide, height: height * share });
  }

  pan(x, y) {
    this.show({ ...this.view, x: this.view.x + x, y: this.view.y + y });
  }

  wheel(event) {
    event.preventDefault();
    this.by(event.deltaY < 0 ? STEP : 1 / STEP, this.at(event.clientX, event.clientY));
  }

  down(event) {
    if (!this.pointers.size) this.dragged = false;
    this.pointers.set(event.pointerId, event);
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    if (this.view !== this.drawn) this.draw();
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    if (!this.dragged && Math.hypot(dx, dy) < MOVED_PX) return;
    if (!this.dragged) this.host.setPointerCapture(event.pointerId);
    this.dragged = true;
    const other = [...this.pointers.values()].find((each) => each.pointerId !== event.pointerId);
    if (other) {
      const apart = (each) => Math.hypot(each.clientX - other.clientX, each.clientY - other.clientY) || 1;
      this.by(apart(event) / apart(before), this.at((event.clientX + other.clientX) / 2, (event.clientY + other.clientY) / 2));
    }
    const { unit } = this.scale();
    if (other) this.pan((-dx * unit) / 2, (-dy * unit) / 2);
    else this.slide(-dx * unit, -dy * unit, unit);
    this.pointers.set(event.pointerId, event);
  }

  // Whether the key was one of these.
  key(key) {
    const arrow = ARROWS[key];
    if (arrow) this.pan((arrow[0] * this.view.width) / 10, (arrow[1] * this.view.height) / 10);
    else if (key === "+" || key === "=") this.by(STEP);
    else if (key === "-") this.by(1 / STEP);
    else if (key === "0") this.fit();
    else return false;
    return true;
  }
}
