// Moves the camera of the 3D view to another place: smoothly, or at once for people who want less motion.

import * as THREE from "three";
import type { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Vec3 } from "./data.ts";

/** From where the 3D view is looked at, relative to its origin. */
export interface Pose {
  position: Vec3;
  target: Vec3;
  up: Vec3;
  /** Angle of the view from top to bottom, degrees. */
  fov: number;
}

/** Duration of a flight in milliseconds. */
const DURATION = 450;

export class Flight {
  private asked = 0;

  constructor(
    private readonly camera: THREE.PerspectiveCamera,
    private readonly controls: OrbitControls,
    private readonly moved: () => void,
  ) {}

  /** Flies to a pose. */
  to(pose: Pose): void {
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.jump(pose);
      return;
    }
    this.stop();
    const { camera, controls } = this;
    const [target, offset] = [controls.target.clone(), camera.position.clone().sub(controls.target)];
    const [up, fov, distance] = [camera.up.clone(), camera.fov, offset.length()];
    const goal = new THREE.Vector3(...pose.target);
    const away = new THREE.Vector3(...pose.position).sub(goal);
    const turn = new THREE.Quaternion().setFromUnitVectors(offset.clone().normalize(), away.clone().normalize());
    const start = performance.now();
    const step = (now: number): void => {
      const share = Math.min(1, Math.max(0, (now - start) / DURATION));
      if (share === 1) {
        this.jump(pose);
        return;
      }
      const s = share * share * (3 - 2 * share);
      controls.target.lerpVectors(target, goal, s);
      const now_ = offset.clone().applyQuaternion(new THREE.Quaternion().slerp(turn, s));
      // Distances change by the same factor in the same time.
      now_.setLength(distance * (away.length() / distance) ** s);
      camera.position.copy(controls.target).add(now_);
      camera.up.lerpVectors(up, new THREE.Vector3(...pose.up), s).normalize();
      camera.fov = fov + s * (pose.fov - fov);
      this.update();
      this.asked = requestAnimationFrame(step);
    };
    this.asked = requestAnimationFrame(step);
  }

  /** Is there at once. */
  jump(pose: Pose): void {
    this.stop();
    this.controls.target.set(...pose.target);
    this.camera.position.set(...pose.position);
    this.camera.up.set(...pose.up);
    this.camera.fov = pose.fov;
    this.update();
  }

  /** Stops where it is, as when someone takes over. */
  stop(): void {
    cancelAnimationFrame(this.asked);
  }

  private update(): void {
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.moved();
  }
}
