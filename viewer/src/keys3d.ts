// The 3D view by keyboard.

import * as THREE from "three";

/**
 * Moves a camera as a key says: arrows turn, with shift they shift, plus and minus zoom. Returns whether it was such a
 * key.
 */
export function moveByKey(event: KeyboardEvent, camera: THREE.Camera, target: THREE.Vector3, up: THREE.Vector3): boolean {
  const offset = camera.position.clone().sub(target);
  const aside = new THREE.Vector3().crossVectors(up, offset).normalize();
  const turn = (axis: THREE.Vector3, angle: number): void => void offset.applyAxisAngle(axis, angle);
  const shift = (axis: THREE.Vector3, share: number): void => void target.addScaledVector(axis, share * offset.length());
  const screenUp = new THREE.Vector3(0, 1, 0).applyQuaternion(camera.quaternion);
  const steep = up.angleTo(offset);
  switch ((event.shiftKey ? "Shift+" : "") + event.key) {
    case "ArrowLeft": turn(up, -0.12); break;
    case "ArrowRight": turn(up, 0.12); break;
    case "ArrowUp": if (steep > 0.2) turn(aside, -0.12); break;
    case "ArrowDown": if (steep < Math.PI - 0.2) turn(aside, 0.12); break;
    case "Shift+ArrowLeft": shift(aside, -0.06); break;
    case "Shift+ArrowRight": shift(aside, 0.06); break;
    case "Shift+ArrowUp": shift(screenUp, 0.06); break;
    case "Shift+ArrowDown": shift(screenUp, -0.06); break;
    case "+": case "=": case "Shift++": offset.multiplyScalar(0.85); break;
    case "-": case "Shift+_": offset.multiplyScalar(1 / 0.85); break;
    default: return false;
  }
  camera.position.copy(target).add(offset);
  return true;
}
