// The names of the objects in the 3D view.

import { MANY } from "./bodies3d.ts";
import type { Colors } from "./colors.ts";
import type { Report, Vec3 } from "./data.ts";
import type { Filter } from "./filter.ts";
import type { Label3d } from "./labels3d.ts";
import { add, scale } from "./linear.ts";
import { objectName } from "./words.ts";

/** Names of the objects that are shown, the selected one first; of many only that one's. */
export function objectLabels(report: Report, selected: number, filter: Filter, colors: Colors, up: Vec3): Label3d[] {
  const all = report.objects.map((_, index) => index);
  const wanted = all.filter((index) => index !== selected && filter.shows(index));
  const named = [...(selected < 0 ? [] : [selected]), ...(all.length > MANY ? [] : wanted)];
  return named.flatMap((index) => {
    const object = report.objects[index];
    const body = object?.body ?? object?.truth;
    const center = body?.center ?? object?.center;
    if (center == null) return [];
    const at = body == null ? center : add(center, scale(up, Math.min(...body.half)));
    const [text, color] = [objectName(report, index), colors.ofObject(index)];
    return [{ text, at, color, must: index === selected, object: index }];
  });
}
