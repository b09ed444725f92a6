// The 3D view: bodies, cameras and surroundings, looked at from anywhere. A picture is drawn when something changes.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Report } from "./data.ts";
import {
  MANY, bodyMeshes, bodyWires, colorBodies, groupOf, lines, placement, unitGeometry, type BodyMesh, type Which,
} from "./bodies3d.ts";
import { wireframe } from "./body_shape.ts";
import { Cameras3d } from "./cameras3d.ts";
import type { Colors } from "./colors.ts";
import { oncePerPicture, onTheme, themeColor } from "./dom.ts";
import { subtract } from "./linear.ts";
import type { Selection } from "./selection.ts";
import { firstLook, type Space } from "./space.ts";
import { Surroundings3d } from "./surroundings3d.ts";

/** What can be switched on and off. */
export type Layer = Which | "cameras" | "path" | "grid";

export class View3d {
  readonly canvas: HTMLCanvasElement;
  readonly gridStep: number;
  private readonly renderer: THREE.WebGLRenderer;
  private readonly world = new THREE.Scene();
  private readonly camera = new THREE.PerspectiveCamera(40, 1, 0.01, 1000);
  private readonly controls: OrbitControls;
  private readonly light = new THREE.DirectionalLight("#ffffff", 1.8);
  private readonly bodies: BodyMesh[];
  private readonly cameras: Cameras3d;
  private readonly surroundings: Surroundings3d;
  private readonly layers: Record<Layer, THREE.Object3D>;
  private readonly wires = new THREE.LineBasicMaterial();
  private readonly highlight = new THREE.Group();
  private size: [number, number] = [0, 0];
  private readonly redraw = oncePerPicture(() => this.draw());

  /** @throws when the browser has no WebGL 2 */
  constructor(
    private readonly report: Report,
    private readonly space: Space,
    private readonly selection: Selection,
    private readonly colors: Colors,
    private readonly place: HTMLElement,
  ) {
    // Smooth edges cost four times the pixels.
    this.renderer = new THREE.WebGLRenderer({ antialias: report.objects.length <= MANY, alpha: true });
    this.canvas = this.renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    place.append(this.canvas);
    const { origin } = space;
    this.bodies = bodyMeshes(report, "body", origin, translucent(0.6, "#ffffff"));
    const shells = bodyMeshes(report, "centerShell", origin, translucent(0.45, "#ff9a00"));
    const enclosing = bodyMeshes(report, "enclosing", origin, translucent(0.16, "#8a8a8a"));
    this.cameras = new Cameras3d(report, space, this.redraw);
    this.surroundings = new Surroundings3d(space);
    this.gridStep = this.surroundings.step;
    this.layers = {
      body: groupOf(this.bodies),
      centerShell: groupOf(shells),
      enclosing: groupOf(enclosing),
      truth: bodyWires(report, "truth", origin, this.wires),
      cameras: this.cameras.group,
      path: this.cameras.path,
      grid: this.surroundings.group,
    };
    this.layers.enclosing.visible = false;
    this.layers.path.visible = this.cameras.isTrack;
    // Hundreds of shells are hard to see and cost as much time as the bodies.
    this.layers.centerShell.visible = report.objects.length <= MANY;
    // The centre's shell lies within its body: it is drawn over it.
    for (const { mesh } of shells) {
      mesh.renderOrder = 2;
      (mesh.material as THREE.Material).depthTest = false;
    }
    this.world.add(new THREE.HemisphereLight("#ffffff", "#8d8d99", 1.6), this.light, this.highlight);
    this.world.add(...Object.values(this.layers));
    this.controls = this.makeControls();
    this.canvas.addEventListener("keydown", (event) => this.onKey(event));
    this.listenToClicks();
    new ResizeObserver(this.redraw).observe(place);
    onTheme(() => this.paint());
    selection.onChange((now, before) => {
      if (now.frame !== before.frame) this.cameras.select(now.frame);
      if (now.object !== before.object) this.paint();
      this.redraw();
    });
    this.cameras.select(selection.frame);
    this.home();
  }

  has(layer: Layer): boolean {
    if (layer === "cameras") return this.report.frames.length > 0;
    if (layer === "path") return this.report.frames.length > 1;
    return layer === "grid" || this.report.objects.some((object) => object[layer] !== null);
  }

  isShown(layer: Layer): boolean {
    return this.layers[layer].visible;
  }

  show(layer: Layer, visible: boolean): void {
    this.layers[layer].visible = visible;
    this.redraw();
  }

  /** Looks where one looks at first. */
  home(): void {
    this.lookAtOrigin(this.space.firstRadius);
  }

  /** Looks at everything. */
  lookAtAll(): void {
    this.lookAtOrigin(1.1 * this.space.radius);
  }

  /** Looks at the objects. */
  lookAtObjects(): void {
    this.lookAtOrigin(1.2 * this.space.objectRadius);
  }

  private lookAtOrigin(radius: number): void {
    this.controls.target.set(0, 0, 0);
    this.lookFrom(new THREE.Vector3(...firstLook(this.space)), radius);
  }

  /** Looks at an object from where one is, from near. */
  lookAt(index: number): void {
    const object = this.report.objects[index];
    const body = object?.body ?? object?.truth;
    const center = body?.center ?? object?.center;
    if (center == null) return;
    const direction = this.camera.position.clone().sub(this.controls.target).normalize();
    this.controls.target.set(...subtract(center, this.space.origin));
    this.lookFrom(direction, body == null ? 0.2 * this.space.objectRadius : 3 * Math.max(...body.half));
  }

  /** Puts the camera in this direction from the target, so far that a ball of this radius is in sight. */
  private lookFrom(direction: THREE.Vector3, radius: number): void {
    const angle = Math.atan(Math.tan((this.camera.fov * Math.PI) / 360) * Math.min(1, this.camera.aspect));
    const distance = radius / Math.sin(angle);
    this.camera.position.copy(this.controls.target).addScaledVector(direction, distance);
    this.controls.update();
    this.redraw();
  }

  private makeControls(): OrbitControls {
    this.camera.up.set(...this.space.up);
    this.camera.near = this.space.radius / 1000;
    this.camera.far = 200 * this.space.radius;
    const controls = new OrbitControls(this.camera, this.canvas);
    controls.zoomToCursor = true;
    controls.minDistance = this.space.radius / 300;
    controls.maxDistance = 40 * this.space.radius;
    controls.addEventListener("change", this.redraw);
    return controls;
  }

  private onKey(event: KeyboardEvent): void {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const upright = new THREE.Vector3(...this.space.up);
    const aside = new THREE.Vector3().crossVectors(upright, offset).normalize();
    const turn = (axis: THREE.Vector3, angle: number): void => void offset.applyAxisAngle(axis, angle);
    const shift = (axis: THREE.Vector3, share: number): void =>
      void this.controls.target.addScaledVector(axis, share * offset.length());
    const screenUp = new THREE.Vector3(0, 1, 0).applyQuaternion(this.camera.quaternion);
    const steep = upright.angleTo(offset);
    switch ((event.shiftKey ? "Shift+" : "") + event.key) {
      case "ArrowLeft": turn(upright, -0.12); break;
      case "ArrowRight": turn(upright, 0.12); break;
      case "ArrowUp": if (steep > 0.2) turn(aside, -0.12); break;
      case "ArrowDown": if (steep < Math.PI - 0.2) turn(aside, 0.12); break;
      case "Shift+ArrowLeft": shift(aside, -0.06); break;
      case "Shift+ArrowRight": shift(aside, 0.06); break;
      case "Shift+ArrowUp": shift(screenUp, 0.06); break;
      case "Shift+ArrowDown": shift(screenUp, -0.06); break;
      case "+": case "=": case "Shift++": offset.multiplyScalar(0.85); break;
      case "-": case "Shift+_": offset.multiplyScalar(1 / 0.85); break;
      case "Home": this.home(); event.preventDefault(); return;
      default: return;
    }
    event.preventDefault();
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.redraw();
  }

  /** A click selects what is under it; a drag does not. */
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
    const frame = this.layers.cameras.visible ? this.cameras.pick(place, this.camera, width, height, 8) : -1;
    if (frame >= 0) {
      this.selection.selectFrame(frame);
      return;
    }
    const ray = new THREE.Raycaster();
    ray.setFromCamera(place, this.camera);
    const hit = ray.intersectObjects(this.bodies.map(({ mesh }) => mesh))[0];
    const bodies = this.bodies.find(({ mesh }) => mesh === hit?.object);
    this.selection.selectObject(bodies?.objects[hit?.instanceId ?? -1] ?? -1);
  }

  /** Colours for the theme and the selection. */
  private paint(): void {
    const paper = themeColor("--paper");
    this.wires.color.set(themeColor("--wire"));
    this.cameras.setColors(themeColor("--camera"), themeColor("--accent"));
    this.surroundings.setColor(themeColor("--grid"));
    colorBodies(this.bodies, this.colors, this.selection.object, paper);
    this.paintHighlight();
    this.redraw();
  }

  /** The selected body once more: stronger and with wires; and the wires of the others that fit its views as well. */
  private paintHighlight(): void {
    this.highlight.clear();
    const body = this.report.objects[this.selection.object]?.body;
    if (body == null) return;
    const color = this.colors.ofObject(this.selection.object);
    const mesh = new THREE.Mesh(unitGeometry(body, 1), translucent(0.75, color));
    mesh.applyMatrix4(placement(body, this.space.origin));
    const accent = new THREE.LineBasicMaterial({ color: themeColor("--accent"), depthTest: false, transparent: true });
    const outline = lines(wireframe(body), this.space.origin, accent);
    outline.renderOrder = 3;
    this.highlight.add(mesh, outline);
    for (const other of this.report.objects[this.selection.object]?.alternatives ?? []) {
      const wires = lines(wireframe(other.body), this.space.origin, this.wires);
      wires.renderOrder = 3;
      this.highlight.add(wires);
    }
  }

  /** Fits the picture to its place; in a narrow view as much is seen from side to side as in a square one. */
  private resize(): void {
    const [width, height] = [this.place.clientWidth, this.place.clientHeight];
    if (width === 0 || height === 0 || (width === this.size[0] && height === this.size[1])) return;
    this.size = [width, height];
    const before = Math.min(1, this.camera.aspect);
    this.camera.aspect = width / height;
    const offset = this.camera.position.clone().sub(this.controls.target);
    offset.multiplyScalar(before / Math.min(1, this.camera.aspect));
    this.camera.position.copy(this.controls.target).add(offset);
    this.camera.updateProjectionMatrix();
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height);
  }

  private draw(): void {
    // With the picture that follows, or the canvas would be seen empty.
    this.resize();
    this.light.position.copy(this.camera.position);
    this.renderer.render(this.world, this.camera);
  }
}

function translucent(opacity: number, color: string): THREE.Material {
  return new THREE.MeshLambertMaterial({ color, transparent: true, opacity, depthWrite: false });
}
