// The 3D view: bodies, cameras and surroundings, looked at from anywhere. A picture is drawn when something changes.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Report } from "./data.ts";
import { BodyLayer, MANY, bodyWires, type Which } from "./bodies3d.ts";
import { Cameras3d } from "./cameras3d.ts";
import type { Colors } from "./colors.ts";
import { oncePerPicture, onTheme, themeColor } from "./dom.ts";
import type { Filter } from "./filter.ts";
import { Flight, type Pose } from "./flight.ts";
import { highlight } from "./highlight3d.ts";
import { isInSight } from "./in_sight3d.ts";
import { moveByKey } from "./keys3d.ts";
import { Labels3d } from "./labels3d.ts";
import { FOV, Looks, type Side } from "./looks3d.ts";
import type { Measure } from "./measure.ts";
import { objectLabels } from "./object_labels.ts";
import { pick } from "./pick3d.ts";
import { Points3d } from "./points3d.ts";
import type { Selection } from "./selection.ts";
import { ScreenBoxes } from "./screen_boxes.ts";
import type { Space } from "./space.ts";
import { skyLight, Surroundings3d } from "./surroundings3d.ts";

/** What can be switched on and off. */
export type Layer = Which | "cameras" | "given" | "path" | "points" | "grid" | "names";

/** Opacity of the bodies, and when one looks through a camera, so that its image is seen behind them. */
const [SOLID, SHEER] = [0.9, 0.45];

/** Opacity of a region of uncertainty that is about as large as its object. */
const FAINT = 0.16;

export class View3d {
  readonly canvas: HTMLCanvasElement;
  readonly gridStep: number;
  private readonly renderer: THREE.WebGLRenderer;
  private readonly world = new THREE.Scene();
  private readonly camera = new THREE.PerspectiveCamera(FOV, 1, 0.01, 1000);
  private readonly controls: OrbitControls;
  private readonly flight: Flight;
  private readonly looks: Looks;
  private readonly boxes: ScreenBoxes | null;
  private readonly light = new THREE.DirectionalLight("#ffffff", 2.2);
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
  /** Whether one looks at one object from near, and has not turned away. */
  private isNear = false;
  /** Whether the selection changes by a click into this view: that moves nothing, a second click does. */
  private isPicking = false;
  /** Whether the image of the selected frame stands behind the objects, as its camera sees it. */
  private isCameraView = false;
  /** Whether one looks through that camera, and has not turned away. */
  private isThrough = false;
  /** The object and the camera, -1 for none, that were under the pointer at the first click of two. */
  private clicked = { object: -1, frame: -1 };
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
      new BodyLayer(report, which, origin, {
        opacity, color, shows, over, dashed: which === "body", ...(over ? { largeOpacity: FAINT } : {}),
      });
    this.bodies = {
      body: layer("body", SOLID, (object) => this.colorOf(object)),
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
    // Boxes of hundreds of objects would leave no place for a label.
    this.boxes = report.objects.length <= MANY ? new ScreenBoxes(report, origin) : null;
    this.world.add(skyLight(space.up), this.light, this.chosen);
    this.world.add(...Object.values(this.layers));
    this.controls = this.makeControls();
    this.flight = new Flight(this.camera, this.controls, this.redraw);
    this.looks = new Looks(report, space, () => this.cameras.points(), this.controls.minDistance);
    this.canvas.addEventListener("keydown", (event) => this.onKey(event));
    this.listenToClicks();
    new ResizeObserver(this.redraw).observe(place);
    this.refilter();
    onTheme(() => this.paint());
    selection.onChange((now, before) => {
      if (now.frame !== before.frame) {
        if (this.isThrough) this.lookFromCamera();
        else this.cameras.select(now.frame, this.isCameraView);
      }
      if (now.object !== before.object) {
        this.paint();
        this.follow(now.object);
      }
      this.redraw();
    });
    colors.onChange(() => this.paint());
    filter.onChange(() => this.refilter());
    measure.onChange(() => this.paintChosen());
    this.cameras.select(selection.frame, false);
    this.resize();
    this.home(true);
    this.follow(selection.object, true);
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
  home(atOnce = false): void {
    this.look(this.looks.side("free", this.camera.aspect), atOnce);
    this.isFirst = true;
  }

  /** Looks at the objects from a side. */
  lookFrom(side: Side): void {
    this.look(this.looks.side(side, this.camera.aspect));
  }

  /** Looks at everything. */
  lookAtAll(): void {
    this.look(this.looks.everything(this.camera.aspect));
  }

  /** Looks at an object from where one is, from near. */
  focus(index: number, atOnce = false): void {
    const { x, y, z } = this.camera.position.clone().sub(this.controls.target).normalize();
    const pose = this.looks.object(index, [x, y, z], this.camera.aspect);
    if (pose === null) return;
    this.look(pose, atOnce);
    this.isNear = true;
  }

  /** Flies to an object that was selected elsewhere: from another one that was looked at, or where it is not in sight. */
  private follow(index: number, atOnce = false): void {
    if (index < 0 || this.isPicking || this.isThrough) return;
    if (this.isNear || !isInSight(this.report.objects[index], this.camera, this.space.origin)) this.focus(index, atOnce);
  }

  /** Looks through the camera of the selected frame, whose image then stands behind the objects. */
  lookFromCamera(atOnce = false): void {
    const pose = this.looks.frame(this.selection.frame, this.camera.aspect);
    if (pose === null) return;
    this.look(pose, atOnce);
    this.isThrough = true;
    this.setCameraView(true);
  }

  /** The view as a picture with its labels. */
  picture(): HTMLCanvasElement {
    this.draw();
    const picture = document.createElement("canvas");
    [picture.width, picture.height] = [this.canvas.width, this.canvas.height];
    const context = picture.getContext("2d");
    if (context === null) return picture;
    context.fillStyle = themeColor("--paper");
    context.fillRect(0, 0, picture.width, picture.height);
    context.drawImage(this.canvas, 0, 0);
    this.labels.drawOn(context, this.renderer.getPixelRatio());
    return picture;
  }

  private look(pose: Pose, atOnce = false): void {
    this.leave();
    this.setCameraView(false);
    if (atOnce) this.flight.jump(pose);
    else this.flight.to(pose);
  }

  /** Where one looks from is no longer a place that follows the size of the view and the selection. */
  private leave(): void {
    [this.isFirst, this.isNear, this.isThrough] = [false, false, false];
    this.flight.stop();
  }

  private setCameraView(isCameraView: boolean): void {
    if (!isCameraView && !this.isCameraView) return;
    this.isCameraView = isCameraView;
    this.cameras.select(this.selection.frame, isCameraView);
    this.bodies.body.setOpacity(isCameraView ? SHEER : SOLID);
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
    controls.addEventListener("start", () => {
      this.leave();
      // Who turns the view keeps the horizon level.
      this.camera.up.set(...this.space.up);
    });
    return controls;
  }

  private onKey(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Home") this.home();
    else if (event.key.toLowerCase() === "f" && this.selection.object >= 0) this.focus(this.selection.object);
    else if (moveByKey(event, this.camera, this.controls.target, new THREE.Vector3(...this.space.up))) this.leave();
    else return;
    event.preventDefault();
    this.controls.update();
    this.redraw();
  }

  /** A click selects what is under it, with shift it measures to it, a second one focuses it; a drag does nothing. */
  private listenToClicks(): void {
    let down: [number, number] | null = null;
    this.canvas.addEventListener("pointerdown", (event) => (down = [event.clientX, event.clientY]));
    this.canvas.addEventListener("click", (event) => {
      const isClick = down !== null && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < 4;
      if (isClick && event.detail < 2) this.pick(event);
    });
    this.canvas.addEventListener("dblclick", () => {
      if (this.clicked.object >= 0) this.focus(this.clicked.object);
      else if (this.clicked.frame >= 0) this.lookFromCamera();
    });
  }

  private pick(event: MouseEvent): void {
    const bodies = this.layers.body.visible ? this.bodies.body : null;
    const cameras = this.layers.cameras.visible ? this.cameras : null;
    this.clicked = pick(event, this.canvas, this.camera, bodies, cameras);
    const { object, frame } = this.clicked;
    this.isPicking = true;
    if (event.shiftKey && this.selection.object >= 0) this.measure.choose(object);
    else if (object < 0 && frame >= 0) this.selection.selectFrame(frame);
    else this.selection.selectObject(object);
    this.isPicking = false;
  }

  /** The color of a body; where one is selected, the others pale. */
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

  /** Colors for the theme and the selection. */
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
    const names = this.showsNames ? objectLabels(this.report, object, this.filter, this.colors, this.space.up) : [];
    // The selected object's name and lengths have the first choice of places.
    const own = names.findIndex(({ must }) => !must);
    const first = own < 0 ? names.length : own;
    this.labels.set([...names.slice(0, first), ...lengths, ...names.slice(first), ...axes]);
    this.redraw();
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
    if (this.resize()) {
      if (this.isFirst) this.home(true);
      else if (this.isThrough) this.lookFromCamera(true);
    }
    // From the upper left behind the viewer: from the viewer's place itself, bodies would look flat.
    this.light.position.set(-0.7, 0.9, 1).applyQuaternion(this.camera.quaternion);
    const shows = (object: number): boolean => this.filter.shows(object);
    const boxes = this.boxes?.of(this.camera, ...this.size, shows) ?? [];
    this.cameras.fade(this.camera, ...this.size, boxes);
    this.renderer.render(this.world, this.camera);
    this.labels.place(this.camera, ...this.size, boxes);
  }
}
