// The canvas: surfaces drawn from one camera, alone, on both sides of a line, or side by side.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { colorMap, STEPS } from "./colors";
import { Drawn } from "./drawn";
import { Field, Model } from "./model";
import { Picker } from "./picking";
import { LIGHTS, Mode, State, Up, View } from "./state";

const FIELD_OF_VIEW = 30; // degrees, over the shorter side of what is seen, as `render` takes it
const Y = new THREE.Vector3(0, 1, 0);
const Z = new THREE.Vector3(0, 0, 1);
const SLOPE = Math.tan((FIELD_OF_VIEW / 2) * (Math.PI / 180));

export interface Pane {
  name: string; // of the surface
  x: number; // in CSS pixels, as the others
  width: number;
  from: number; // the camera looks at the middle of x … x + width, and what is seen is from … to of it
  to: number;
}

export interface Picked {
  name: string; // of the surface
  face: number;
  point: THREE.Vector3;
}

export class Stage {
  readonly camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
  private controls: OrbitControls;
  readonly canvas: HTMLCanvasElement;
  onMove: () => void = () => {};
  onFrame: () => void = () => {};
  private readonly renderer: THREE.WebGLRenderer;
  private readonly scene = new THREE.Scene();
  private drawn = new Map<string, Drawn>();
  private readonly pickers = new Map<string, Picker>();
  private readonly maps: Record<"signed" | "unsigned", THREE.DataTexture>;
  private readonly shared: Record<string, THREE.IUniform>;
  private waiting = false;
  private flight = 0;

  constructor(
    private model: Model,
    public state: State,
  ) {
    this.renderer = new THREE.WebGLRenderer({ antialias: true, powerPreference: "high-performance" });
    this.canvas = this.renderer.domElement;
    this.maps = { signed: mapTexture(true), unsigned: mapTexture(false) };
    this.shared = {
      colorMap: { value: this.maps.unsigned },
      smoothShading: { value: false },
      wireframe: { value: false },
      hasRange: { value: false },
      limits: { value: new THREE.Vector2(0, 1) },
      range: { value: new THREE.Vector2() },
      light: { value: 0 },
      angle: { value: 0 },
      accent: { value: new THREE.Vector3(1, 0.5, 0) },
    };
    this.hold(model);
    this.controls = this.newControls();
    this.look(state.view);
  }

  // Show other meshes, from where the camera is or as a whole.
  show(model: Model, samePlace: boolean): void {
    const { from, target, distance } = this.view();
    const { size, center } = this.model;
    this.hold(model);
    const there = target.map((value, axis) => (value * size + center[axis] - model.center[axis]) / model.size);
    this.look(samePlace ? { from, target: there, distance: (distance * size) / model.size } : this.home());
  }

  repaint(field: Field): void {
    for (const drawn of this.drawn.values()) drawn.repaint(field);
    this.draw();
  }

  get field(): Field | null {
    return this.model.fields.find((field) => field.name === this.state.color) ?? null;
  }

  get limits(): [number, number] {
    return this.state.limits ?? this.field?.limits ?? [0, 1];
  }

  // A surface alone needs one pane.
  get mode(): Mode {
    return this.model.surfaces.length > 1 ? this.state.mode : "one";
  }

  panes(): Pane[] {
    const { mode } = this;
    const { left, right, split } = this.state;
    const width = this.canvas.clientWidth;
    if (mode === "one") return [{ name: left, x: 0, width, from: 0, to: width }];
    if (mode === "split") {
      return [
        { name: left, x: 0, width, from: 0, to: split * width },
        { name: right, x: 0, width, from: split * width, to: width },
      ];
    }
    const half = width / 2;
    return [
      { name: left, x: 0, width: half, from: 0, to: half },
      { name: right, x: half, width: half, from: half, to: width },
    ];
  }

  // Where the camera is, in the words of the state.
  view(): View {
    const from = this.camera.position.clone().sub(this.controls.target);
    const distance = from.length();
    return { from: from.divideScalar(distance).toArray(), target: this.controls.target.toArray(), distance };
  }

  home(): View {
    this.fit();
    const aspect = this.panes()[0].width / Math.max(this.canvas.clientHeight, 1) || 1;
    const { target, reach } = this.model.view;
    const { up } = this.state;
    const from = turnedUp(this.model.view.from, "y", up);
    const [width, height] = up === "y" ? reach : [this.model.radius, this.model.radius];
    const far = Math.max(width / Math.max(aspect, 1), height / Math.max(1 / aspect, 1)) / SLOPE || this.model.radius;
    return { from, target, distance: 1.08 * far + 0.7 * Math.max(width, height) }; // what is nearer looks larger
  }

  // Whether the mesh is seen as a whole, from where it is seen at first.
  get atHome(): boolean {
    const [now, home] = [this.view(), this.home()].map(({ from, target, distance }) => [...from, ...target, distance]);
    return now.every((value, i) => Math.abs(value - home[i]) < 1e-3 * Math.max(1, home[6]));
  }

  look({ from, target, distance }: View): void {
    this.orient();
    this.controls.target.fromArray(target);
    this.camera.position.fromArray(from).setLength(distance).add(this.controls.target);
    this.controls.update();
    this.draw();
  }

  // Let another axis of the mesh point up; the camera turns with it.
  setUp(up: Up): void {
    const { from, ...view } = this.view();
    const before = this.state.up;
    this.state.up = up;
    this.look({ from: turnedUp(from, before, up), ...view });
  }

  // Turn by angles in radians, and come nearer by a factor.
  turn(right: number, up: number, nearer = 1): void {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const upright = new THREE.Quaternion().setFromUnitVectors(this.camera.up, Y);
    const place = new THREE.Spherical().setFromVector3(offset.applyQuaternion(upright));
    place.theta -= right;
    place.phi = Math.min(Math.max(place.phi - up, 0.01), Math.PI - 0.01);
    place.radius /= nearer;
    this.camera.position.setFromSpherical(place).applyQuaternion(upright.invert()).add(this.controls.target);
    this.controls.update();
    this.moved();
  }

  // The controls take over the axis when they are made.
  private orient(): void {
    const up = this.state.up === "y" ? Y : Z;
    if (this.camera.up.equals(up)) return;
    this.camera.up.copy(up);
    this.controls.dispose();
    this.controls = this.newControls();
  }

  private newControls(): OrbitControls {
    const controls = new OrbitControls(this.camera, this.canvas);
    controls.zoomToCursor = true;
    controls.addEventListener("change", () => this.moved());
    return controls;
  }

  // Go to a point of a surface and look at it along its normal.
  fly(name: string, point: THREE.Vector3, radius: number): void {
    const { normal, spacing } = this.picker(name).near(point);
    const start = this.view();
    const from = normal.lengthSq() > 0 ? normal.toArray() : start.from;
    const distance = Math.min(Math.max(8 * radius, 24 * spacing), this.home().distance);
    const end: View = { from, target: point.toArray(), distance };
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const began = performance.now();
    cancelAnimationFrame(this.flight);
    const step = () => {
      const time = still ? 1 : Math.min((performance.now() - began) / 600, 1);
      const part = time * time * (3 - 2 * time);
      const mix = (a: number[], b: number[]) => a.map((value, i) => value + part * (b[i] - value));
      const between = mix(start.from, end.from);
      this.look({
        from: Math.hypot(...between) > 1e-3 ? between : end.from,
        target: mix(start.target, end.target),
        distance: start.distance * (end.distance / start.distance) ** part,
      });
      if (time < 1) this.flight = requestAnimationFrame(step);
      else this.onMove();
    };
    step();
  }

  picker(name: string): Picker {
    const picker = this.pickers.get(name) ?? new Picker(this.drawn.get(name)!.surface);
    this.pickers.set(name, picker);
    return picker;
  }

  // The surface, its face and the place in the frame under a point of the canvas, in CSS pixels.
  pick(x: number, y: number): Picked | null {
    const pane = this.panes().find(({ from, to }) => x >= from && x < to);
    if (!pane) return null;
    this.shape(pane);
    const at = new THREE.Vector2(((x - pane.x) / pane.width) * 2 - 1, 1 - (y / this.canvas.clientHeight) * 2);
    const caster = new THREE.Raycaster();
    caster.setFromCamera(at, this.camera);
    const hit = this.picker(pane.name).hit(caster.ray);
    return hit && { name: pane.name, ...hit };
  }

  // How long a length on the screen, in CSS pixels, is in the frame where a point is.
  lengthAt(point: THREE.Vector3, pixels: number): number {
    const depth = point.clone().applyMatrix4(this.camera.matrixWorldInverse).z;
    const { width } = this.panes()[0];
    return (pixels * 2 * SLOPE * -depth) / Math.max(Math.min(width, this.canvas.clientHeight), 1);
  }

  mark(picked: { name: string; face: number } | null): void {
    for (const [name, drawn] of this.drawn) {
      const alike = picked && drawn.surface.triangles === this.drawn.get(picked.name)!.surface.triangles;
      drawn.uniforms.picked.value = picked && (name === picked.name || alike) ? picked.face : -1;
    }
    this.draw();
  }

  // Where a point of the frame is on the canvas, pane by pane; null where it is not seen.
  project(point: THREE.Vector3): ({ x: number; y: number } | null)[] {
    return this.panes().map((pane) => {
      this.shape(pane);
      const at = point.clone().project(this.camera);
      const x = pane.x + ((at.x + 1) / 2) * pane.width;
      const seen = at.z < 1 && x >= pane.from && x <= pane.to && Math.abs(at.y) <= 1;
      return seen ? { x, y: ((1 - at.y) / 2) * this.canvas.clientHeight } : null;
    });
  }

  set background(color: string) {
    this.renderer.setClearColor(new THREE.Color(color));
    this.draw();
  }

  set accent(color: string) {
    (this.shared.accent.value as THREE.Vector3).setFromColor(new THREE.Color().setStyle(color, THREE.LinearSRGBColorSpace));
    this.draw();
  }

  // The element that holds the canvas may have another size than what is drawn.
  resized(): void {
    if (!this.fits) this.draw();
  }

  // Draw with the next frame of the browser.
  draw(): void {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.drawNow();
      this.onFrame();
    });
  }

  // Draw the surfaces of a model; one that is drawn already stays as it is.
  private hold(model: Model): void {
    const before = this.drawn;
    this.model = model;
    this.drawn = new Map();
    for (const surface of model.surfaces) {
      const known = before.get(surface.name);
      const drawn = known?.surface === surface ? known : new Drawn(surface, this.shared);
      if (drawn !== known) this.pickers.delete(surface.name);
      this.drawn.set(surface.name, drawn);
      this.scene.add(drawn.object);
    }
    for (const [name, drawn] of before) {
      if (this.drawn.get(name) === drawn) continue;
      this.scene.remove(drawn.object);
      drawn.dispose();
      if (!this.drawn.has(name)) this.pickers.delete(name);
    }
  }

  private moved(): void {
    this.draw();
    this.onMove();
  }

  private drawNow(): void {
    if (!this.fit()) return;
    const height = this.canvas.clientHeight;
    this.adjust();
    this.renderer.setScissorTest(true);
    for (const pane of this.panes()) {
      this.shape(pane);
      for (const [name, drawn] of this.drawn) drawn.object.visible = name === pane.name;
      this.renderer.setViewport(pane.x, 0, pane.width, height);
      this.renderer.setScissor(pane.from, 0, Math.max(pane.to - pane.from, 0), height);
      if (pane.to - pane.from >= 1) this.renderer.render(this.scene, this.camera);
    }
  }

  // Make the canvas as large as the element that holds it; false where that has no size.
  private fit(): boolean {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement ?? this.canvas;
    if (!width || !height) return false;
    if (!this.fits) {
      this.renderer.setPixelRatio(pixelRatio());
      this.renderer.setSize(width, height);
    }
    return true;
  }

  private get fits(): boolean {
    const { canvas, renderer } = this;
    const holder = canvas.parentElement ?? canvas;
    const alike = canvas.clientWidth === holder.clientWidth && canvas.clientHeight === holder.clientHeight;
    return alike && renderer.getPixelRatio() === pixelRatio();
  }

  // Take over the state.
  private adjust(): void {
    const { state, field, shared } = this;
    shared.colorMap.value = field?.signed ? this.maps.signed : this.maps.unsigned;
    shared.smoothShading.value = state.smooth;
    shared.wireframe.value = state.wireframe;
    shared.hasRange.value = state.range !== null;
    (shared.limits.value as THREE.Vector2).fromArray(this.limits);
    if (state.range) (shared.range.value as THREE.Vector2).fromArray(state.range);
    shared.light.value = LIGHTS.indexOf(state.light);
    shared.angle.value = state.angle * (Math.PI / 180);
    for (const { name } of this.panes()) {
      const drawn = this.drawn.get(name)!;
      drawn.paint(field, state.color === "vertex");
      if (state.smooth) drawn.needsNormals();
    }
  }

  private shape(pane: Pane): void {
    const away = this.camera.position.length(); // the model is around the origin
    const reach = 1.05 * this.model.radius;
    this.camera.near = Math.max(away - reach, 0.02 * this.camera.position.distanceTo(this.controls.target));
    this.camera.far = away + reach;
    this.camera.aspect = pane.width / Math.max(this.canvas.clientHeight, 1) || 1;
    this.camera.fov = (360 / Math.PI) * Math.atan(SLOPE / Math.min(this.camera.aspect, 1));
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
  }
}

// A direction that lies to one axis as the given one does to another.
function turnedUp([x, y, z]: number[], before: Up, after: Up): number[] {
  if (before === after) return [x, y, z];
  return after === "z" ? [x, -z, y] : [x, z, -y];
}

function pixelRatio(): number {
  return Math.min(devicePixelRatio, 2);
}

function mapTexture(signed: boolean): THREE.DataTexture {
  const texture = new THREE.DataTexture(colorMap(signed), STEPS, 1, THREE.RGBAFormat);
  texture.needsUpdate = true;
  return texture;
}
