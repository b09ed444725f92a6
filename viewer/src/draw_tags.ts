// Names beside the detections of a frame, placed so that they cover neither each other nor objects.

import type { Region } from "./frame_region.ts";
import { placeLabels, type Box } from "./place_labels.ts";

/** A name and the box it belongs to, in pixels of the frame. */
export interface Tag {
  text: string;
  color: string;
  box: Box;
  /** Whether it is drawn even where it covers another one. */
  must: boolean;
  strength: number;
}

/** Beyond this many a picture is covered by names. */
const MOST_TAGS = 80;
const [SIZE, HEIGHT, PAD] = [12, 17, 4];

/** Share of a tag that may lie over objects: their boxes are larger than they are. */
const MAY_COVER = 0.2;

/** Draws the tags into a picture of `region`; those that come first have the first choice of places. */
export function drawTags(
  context: CanvasRenderingContext2D,
  tags: Tag[],
  region: Region,
  scale: number,
  width: number,
): void {
  context.font = `600 ${SIZE}px system-ui, sans-serif`;
  context.textBaseline = "middle";
  const height = region.height * scale;
  const shown = tags.slice(0, MOST_TAGS).flatMap((tag) => {
    const [x0, x1] = [tag.box[0], tag.box[2]].map((x) => (x - region.x) * scale) as [number, number];
    const [y0, y1] = [tag.box[1], tag.box[3]].map((y) => (y - region.y) * scale) as [number, number];
    const isOutside = !(x1 > 0 && x0 < width && y1 > 0 && y0 < height);
    return isOutside ? [] : [{ tag, x0, x1, y0, y1, width: context.measureText(tag.text).width + 2 * PAD }];
  });
  const objects = shown.map(({ x0, y0, x1, y1 }): Box => [x0, y0, x1, y1]);
  const wishes = shown.map(({ tag, x0, x1, y0, y1, width: own }) => {
    const places: [number, number][] = [
      [x0 - 1, y0 - HEIGHT - 1], [x0 - 1, y1 + 1], [x1 - own + 1, y0 - HEIGHT - 1], [x1 - own + 1, y1 + 1],
      [x1 + 2, y0], [x0 - own - 2, y0], [x1 + 2, y1 - HEIGHT], [x0 - own - 2, y1 - HEIGHT],
    ];
    return { width: own, height: HEIGHT, places, must: tag.must, mayCover: MAY_COVER };
  });
  placeLabels(wishes, width, height, objects).forEach((place, k) => {
    const tag = shown[k]?.tag;
    if (place === null || tag === undefined) return;
    const own = wishes[k]?.width ?? 0;
    context.globalAlpha = 0.85 * Math.max(tag.strength, 0.4);
    context.fillStyle = "#101418";
    context.fillRect(place[0], place[1], own, HEIGHT);
    context.fillStyle = tag.color;
    context.fillRect(place[0], place[1], 3, HEIGHT);
    context.globalAlpha = Math.max(tag.strength, 0.6);
    context.fillStyle = "#ffffff";
    context.fillText(tag.text, place[0] + PAD + 1, place[1] + HEIGHT / 2 + 0.5);
  });
}
