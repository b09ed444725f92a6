// The 3D view: bodies, cameras and surroundings, looked at from anywhere. A picture is drawn when something changes.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Report, Vec3 } from "./data.ts";
import { BodyLayer, MANY, bodyWires, type Which } from "./bodies3d.ts";
import { Cameras3d } from "./cameras3d.ts";
import type { Colors } from "./colors.ts";
import { oncePerPicture, onTheme, themeColor } from "./dom.ts";
import type { Filter } from "./filter.ts";
import { fitView } from "./fit_view.ts";
import { highlight } from "./highlight3d.ts";
import { moveByKey } from "./keys3d.ts";
import { Labels3d, type Label3d } from "./labels3d.ts";
import { add, dot, scale, subtract, unit } from "./linear.ts";
import type { Measure } from "./measure.ts";
import { Points3d } from "./points3d.ts";
import type { Selection } from "./selection.ts";
import { firstLook, planeAxes, type Space } from "./space.ts";
import { Surroundings3d } from "./surroundings3d.ts";
import { objectName } from "./words.ts";

/** What can be switched on and off. */
export type Layer = Which | "cameras" | "given" | "path" | "points" | "grid" | "names";

/** From where one looks. */
export type Side = "free" | "top" | "front";

export class View3d {
  readonly canvas: HTMLCanvasElement;
  readonly gridStep: number;
  private readonly renderer: THREE.WebGLRenderer;
  private readonly world = new THREE.Scene();
  private readonly camera = new THREE.PerspectiveCamera(40, 1, 0.01, 1000);
  private readonly controls: OrbitControls;
  private readonly light = new THREE.DirectionalLight("#ffffff", 1.8);
  private readonly bodies: Record<"body" | "enclosing" | "centerShell", BodyLayer>;
  private readonly truth = new THREE.Group();
  private readonly cameras: Cameras3d;
  private readonly points: Points3d;
  private readonly surroundings: Surroundings3d;
  private readonly layers: Record<Exclude<Layer, "names">, THREE.Object3D>;
  private readonly wires = new THREE.LineBasicMaterial();
  private readonly chosen = new THREE.Group();
  private readonly labels: Labels3d;
  private readonly paper = new THREE.Color();
  private showsNames = true;
  private size: [number, number] = [0, 0];
  /** Whether the view is still where it opened: then it is fitted again when its size changes. */
  private isFirst = true;
  private readonly redraw = oncePerPicture(() => this.draw());

  /** @throws when the browser has no WebGL 2 */
  constructor(
    private readonly report: Report,
    private readonly space: Space,
    private readonly selection: Selection,
    private readonly colors: Colors,
    private readonly filter: Filter,
    private readonly measure: Measure,
    private readonly place: HTMLElement,
  ) {
    // Smooth edges cost four times the pixels.
    this.renderer = new THREE.WebGLRenderer({ antialias: report.objects.length <= MANY, alpha: true });
    this.canvas = this.renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    const { origin } = space;
    this.labels = new Labels3d(origin);
    place.append(this.canvas, this.labels.element);
    const shows = (object: number): boolean => filter.shows(object);
    const layer = (which: Which, opacity: number, color: (object: number) => string, over = false): BodyLayer =>
      new BodyLayer(report, which, origin, { opacity, color, shows, over });
    this.bodies = {
      body: layer("body", 0.62, (object) => this.colorOf(object)),
      enclosing: layer("enclosing", 0.16, () => "#8a8a8a"),
      centerShell: layer("centerShell", 0.5, () => "#ff9a00", true),
    };
    this.cameras = new Cameras3d(report, space, this.redraw);
    this.points = new Points3d(report.points, origin);
    this.surroundings = new Surroundings3d(space);
    this.gridStep = this.surroundings.step;
    this.layers = {
      body: this.bodies.body.group,
      centerShell: this.bodies.centerShell.group,
      enclosing: this.bodies.enclosing.group,
      truth: this.truth,
      cameras: this.cameras.group,
      given: this.cameras.given,
      path: this.cameras.path,
      points: this.points.group,
      grid: this.surroundings.group,
    };
    this.layers.enclosing.visible = false;
    this.layers.path.visible = this.cameras.isTrack;
    // Hundreds of shells are hard to see and cost as much time as the bodies.
    this.layers.centerShell.visible = report.objects.length <= MANY;
    this.world.add(new THREE.HemisphereLight("#ffffff", "#8d8d99", 1.6), this.light, this.chosen);
    this.world.add(...Object.values(this.layers));
    this.controls = this.makeControls();
    this.canvas.addEventListener("keydown", (event) => this.onKey(event));
    this.listenToClicks();
    new ResizeObserver(this.redraw).observe(place);
    this.refilter();
    onTheme(() => this.paint());
    selection.onChange((now, before) => {
      if (now.frame !== before.frame) this.cameras.select(now.frame);
      if (now.object !== before.object) this.paint();
      this.redraw();
    });
    colors.onChange(() => this.paint());
    filter.onChange(() => this.refilter());
    measure.onChange(() => this.paintChosen());
    this.cameras.select(selection.frame);
    this.home();
  }

  has(layer: Layer): boolean {
    if (layer === "cameras") return this.report.frames.length > 0;
    if (layer === "given") return this.space.given.some((view) => view !== null);
    if (layer === "path") return this.report.frames.length > 1;
    if (layer === "names") return this.report.objects.length > 0;
    if (layer === "points") return this.report.points.length > 0;
    return layer === "grid" || this.report.objects.some((object) => object[layer] !== null);
  }

  isShown(layer: Layer): boolean {
    return layer === "names" ? this.showsNames : this.layers[layer].visible;
  }

  show(layer: Layer, visible: boolean): void {
    if (layer === "names") this.showsNames = visible;
    else this.layers[layer].visible = visible;
    this.paintChosen();
  }

  /** Looks where one looks at first: at the objects; without any, at the cameras. */
  home(): void {
    this.isFirst = true;
    this.lookFrom("free");
  }

  /** Looks at the objects from a side. */
  lookFrom(side: Side): void {
    this.isFirst = side === "free";
    const objects = this.space.objectPoints;
    this.fit(objects.length > 0 ? objects : this.cameras.points(), this.direction(side));
  }

  /** Looks at everything. */
  lookAtAll(): void {
    this.isFirst = false;
    this.fit([...this.space.objectPoints, ...this.cameras.points()], this.direction("free"));
  }

  /** Looks at an object from where one is, from near. */
  lookAt(index: number): void {
    const object = this.report.objects[index];
    const body = object?.body ?? object?.truth;
    const center = body?.center ?? object?.center;
    if (center == null) return;
    this.isFirst = false;
    const direction = this.camera.position.clone().sub(this.controls.target).normalize();
    const reach = body == null ? 0.2 * this.space.objectRadius : 1.4 * Math.max(...body.half);
    const axes: Vec3[] = [[reach, 0, 0], [0, reach, 0], [0, 0, reach]];
    this.fit(axes.flatMap((axis) => [add(center, axis), subtract(center, axis)]), [direction.x, direction.y, direction.z]);
  }

  /** Looks from the camera of the selected frame. */
  lookFromCamera(): void {
    const view = this.space.viewpoints[this.selection.frame];
    const size = this.report.frames[this.selection.frame]?.size;
    if (view == null || size === undefined) return;
    this.isFirst = false;
    const [forward, below] = [view.direction(size[0] / 2, size[1] / 2), view.direction(size[0] / 2, size[1])];
    const half = Math.acos(Math.min(1, dot(forward, below)));
    const depth = Math.max(0.1 * this.space.objectRadius, -dot(forward, subtract(view.center, this.space.origin)));
    const target = add(view.center, scale(forward, depth));
    // The picture of this view may be narrower than that of the camera.
    const wide = Math.max(1, size[0] / size[1] / this.camera.aspect);
    const back = (depth * wide * Math.tan(half)) / Math.tan((this.camera.fov * Math.PI) / 360);
    this.controls.target.set(...subtract(target, this.space.origin));
    this.camera.position.set(...subtract(subtract(target, scale(forward, back)), this.space.origin));
    this.controls.update();
    this.redraw();
  }

  private direction(side: Side): Vec3 {
    const free = firstLook(this.space);
    if (side === "free") return free;
    const { up } = this.space;
    if (side === "top") return unit(add(up, scale(this.flat(free), 1e-3)), up);
    return this.flat(free);
  }

  /** A direction without its part along `up`, along the nearest axis of the plane across it. */
  private flat(direction: Vec3): Vec3 {
    const [a, b] = planeAxes(this.space.up);
    const [x, y] = [dot(direction, a), dot(direction, b)];
    return Math.abs(x) > Math.abs(y) ? scale(a, Math.sign(x)) : scale(b, Math.sign(y) || 1);
  }

  /** Looks in a direction so that all of these points are in sight. */
  private fit(points: Vec3[], from: Vec3): void {
    this.resize();
    const half = Math.tan((this.camera.fov * Math.PI) / 360);
    const relative = points.map((point) => subtract(point, this.space.origin));
    const [across, upwards] = [0.86 * half * this.camera.aspect, 0.8 * half];
    const found = relative.length === 0
      ? { target: [0, 0, 0] as Vec3, distance: 3 * this.space.radius }
      : fitView(relative, from, this.space.up, [across, upwards]);
    this.controls.target.set(...found.target);
    this.camera.position.set(...add(found.target, scale(from, Math.max(found.distance, 2 * this.controls.minDistance))));
    this.controls.update();
    this.redraw();
  }

  private makeControls(): OrbitControls {
    this.camera.up.set(...this.space.up);
    this.camera.near = this.space.objectRadius / 500;
    this.camera.far = 200 * this.space.radius;
    const controls = new OrbitControls(this.camera, this.canvas);
    controls.zoomToCursor = true;
    controls.minDistance = this.space.objectRadius / 100;
    controls.maxDistance = 40 * this.space.radius;
    controls.addEventListener("change", this.redraw);
    controls.addEventListener("start", () => (this.isFirst = false));
    return controls;
  }

  private onKey(event: KeyboardEvent): void {
    if (event.key === "Home") this.home();
    else if (moveByKey(event, this.camera, this.controls.target, new THREE.Vector3(...this.space.up))) this.isFirst = false;
    else return;
    event.preventDefault();
    this.controls.update();
    this.redraw();
  }

  /** A click selects what is under it, with shift it measures to it; a drag does neither. */
  private listenToClicks(): void {
    let down: [number, number] | null = null;
    this.canvas.addEventListener("pointerdown", (event) => (down = [event.clientX, event.clientY]));
    this.canvas.addEventListener("pointerup", (event) => {
      if (down !== null && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < 4) this.pick(event);
      down = null;
    });
  }

  private pick(event: MouseEvent): void {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const place = new THREE.Vector2(
      (2 * (event.clientX - left)) / width - 1,
      1 - (2 * (event.clientY - top)) / height,
    );
    const ray = new THREE.Raycaster();
    ray.setFromCamera(place, this.camera);
    const object = this.layers.body.visible ? this.bodies.body.pick(ray) : -1;
    if (event.shiftKey && this.selection.object >= 0) {
      this.measure.choose(object);
      return;
    }
    const frame = this.layers.cameras.visible ? this.cameras.pick(place, this.camera, width, height, 8) : -1;
    if (object < 0 && frame >= 0) this.selection.selectFrame(frame);
    else this.selection.selectObject(object);
  }

  /** The colour of a body; where one is selected, the others pale. */
  private colorOf(object: number): string {
    const own = new THREE.Color(this.colors.ofObject(object));
    const { object: selected } = this.selection;
    if (selected >= 0 && selected !== object) own.lerp(this.paper, 0.5);
    return `#${own.getHexString()}`;
  }

  /** Shows what the filter lets through. */
  private refilter(): void {
    for (const layer of Object.values(this.bodies)) layer.rebuild();
    this.truth.clear();
    const shows = (object: number): boolean => this.filter.shows(object);
    this.truth.add(bodyWires(this.report, "truth", this.space.origin, this.wires, shows));
    this.paintChosen();
  }

  /** Colours for the theme and the selection. */
  private paint(): void {
    this.paper.set(themeColor("--paper"));
    this.wires.color.set(themeColor("--wire"));
    this.cameras.setColors(themeColor("--camera"), themeColor("--accent"));
    this.points.setColor(themeColor("--camera"));
    this.surroundings.setColor(themeColor("--grid"), themeColor("--dim"));
    this.bodies.body.rebuild();
    this.paintChosen();
  }

  /** The selected object, and the texts of the view. */
  private paintChosen(): void {
    const { object } = this.selection;
    const style = { color: this.colors.ofObject(object), accent: themeColor("--accent"), ink: themeColor("--ink") };
    const shown = this.filter.shows(object) ? object : -1;
    const lengths = highlight(this.chosen, this.report, shown, this.measure, this.space.origin, style);
    const axes = this.layers.grid.visible ? this.surroundings.names.map((name) => ({ ...name, must: false })) : [];
    const names = this.showsNames ? this.names() : [];
    // The selected object's name and lengths have the first choice of places.
    const own = names.findIndex(({ must }) => !must);
    const first = own < 0 ? names.length : own;
    this.labels.set([...names.slice(0, first), ...lengths, ...names.slice(first), ...axes]);
    this.redraw();
  }

  /** Names of the objects, the selected one first; of many only that one's. */
  private names(): Label3d[] {
    const { object: selected } = this.selection;
    const all = this.report.objects.map((_, index) => index);
    const wanted = all.filter((index) => index !== selected && this.filter.shows(index));
    const named = [...(selected < 0 ? [] : [selected]), ...(all.length > MANY ? [] : wanted)];
    return named.flatMap((index) => {
      const object = this.report.objects[index];
      const body = object?.body ?? object?.truth;
      const center = body?.center ?? object?.center;
      if (center == null) return [];
      const at = body == null ? center : add(center, scale(this.space.up, Math.min(...body.half)));
      return [{ text: objectName(this.report, index), at, color: this.colors.ofObject(index), must: index === selected }];
    });
  }

  /** Fits the picture to its place. */
  private resize(): boolean {
    const [width, height] = [this.place.clientWidth, this.place.clientHeight];
    if (width === 0 || height === 0 || (width === this.size[0] && height === this.size[1])) return false;
    this.size = [width, height];
    const before = Math.min(1, this.camera.aspect);
    this.camera.aspect = width / height;
    // In a narrow view as much is seen from side to side as in a square one.
    const offset = this.camera.position.clone().sub(this.controls.target);
    offset.multiplyScalar(before / Math.min(1, this.camera.aspect));
    this.camera.position.copy(this.controls.target).add(offset);
    this.camera.updateProjectionMatrix();
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height);
    return true;
  }

  private draw(): void {
    // With the picture that follows, or the canvas would be seen empty.
    if (this.resize() && this.isFirst) this.home();
    this.light.position.copy(this.camera.position);
    this.renderer.render(this.world, this.camera);
    this.labels.place(this.camera, ...this.size);
  }
}
