// Where labels stand so that they do not cover each other: each takes the first of its places that is free.

/** A label and the places it may take, the best one first. */
export interface LabelWish {
  width: number;
  height: number;
  /** Upper left corners. */
  places: [number, number][];
  /** Whether it is shown in its first place where none is free. */
  must: boolean;
}

/** A chosen place for each label, in the order given (which is that of their rights); null where none was free. */
export function placeLabels(wishes: LabelWish[], width: number, height: number): ([number, number] | null)[] {
  const taken: [number, number, number, number][] = [];
  return wishes.map((wish) => {
    const inside = ([x, y]: [number, number]): [number, number] => [
      Math.max(0, Math.min(x, width - wish.width)),
      Math.max(0, Math.min(y, height - wish.height)),
    ];
    const isFree = ([x, y]: [number, number]): boolean =>
      taken.every(([x0, y0, x1, y1]) => x >= x1 || x + wish.width <= x0 || y >= y1 || y + wish.height <= y0);
    const places = wish.places.map(inside);
    const place = places.find(isFree) ?? (wish.must ? places[0] : undefined);
    if (place === undefined) return null;
    taken.push([place[0], place[1], place[0] + wish.width, place[1] + wish.height]);
    return place;
  });
}
