// Where labels stand so that they cover neither each other nor objects: each takes the first of its places that is free.

/** x0, y0, x1, y1. */
export type Box = [number, number, number, number];

/** A label and the places it may take, the best one first. */
export interface LabelWish {
  width: number;
  height: number;
  /** Upper left corners. */
  places: [number, number][];
  /** Whether it is shown in its first place where none is free. */
  must: boolean;
  /** Share of its area that may lie over objects where no place is free of them. */
  mayCover?: number;
}

/**
 * A chosen place for each label, in the order given (which is that of their rights); null where none was free. Labels
 * stay out of `objects` as far as they can.
 */
export function placeLabels(
  wishes: LabelWish[],
  width: number,
  height: number,
  objects: Box[] = [],
): ([number, number] | null)[] {
  const taken: Box[] = [];
  return wishes.map((wish) => {
    const boxAt = ([x, y]: [number, number]): Box => {
      const left = Math.max(0, Math.min(x, width - wish.width));
      const top = Math.max(0, Math.min(y, height - wish.height));
      return [left, top, left + wish.width, top + wish.height];
    };
    const all = wish.places.map(boxAt);
    const free = all.filter((box) => taken.every((other) => overlap(box, other) === 0));
    const most = (wish.mayCover ?? 0) * wish.width * wish.height;
    let [chosen, least]: [Box | undefined, number] = [undefined, Infinity];
    for (const box of free) {
      const covered = objects.reduce((sum, other) => sum + overlap(box, other), 0);
      if (covered < least) [chosen, least] = [box, covered];
      if (covered === 0) break;
    }
    // One that must be shown rather covers an object than another label.
    if (least > most && !wish.must) chosen = undefined;
    if (wish.must) chosen ??= all[0];
    if (chosen === undefined) return null;
    taken.push(chosen);
    return [chosen[0], chosen[1]];
  });
}

/** Area that two boxes share. */
export function overlap(a: Box, b: Box): number {
  const [w, h] = [Math.min(a[2], b[2]) - Math.max(a[0], b[0]), Math.min(a[3], b[3]) - Math.max(a[1], b[1])];
  return w > 0 && h > 0 ? w * h : 0;
}
