// What is selected: an object (or none) and a frame. All parts of the page listen here and never to each other.

export interface Selected {
  /** Index of the object, -1 for none. */
  object: number;
  /** Index of the frame, -1 when there are no frames. */
  frame: number;
}

export class Selection {
  private selected: Selected;
  private readonly listeners: ((now: Selected, before: Selected) => void)[] = [];

  /** `bestFrame` names the frame that shows an object best, -1 for none. */
  constructor(start: Selected, private readonly bestFrame: (object: number) => number) {
    this.selected = start;
  }

  get object(): number {
    return this.selected.object;
  }

  get frame(): number {
    return this.selected.frame;
  }

  /** Selects an object and the frame that shows it best; or no object with -1. */
  selectObject(object: number): void {
    const best = object < 0 || object === this.selected.object ? -1 : this.bestFrame(object);
    this.change({ object, frame: best < 0 ? this.selected.frame : best });
  }

  /** Selects an object that was chosen in the frame that is shown, which stays. */
  selectInFrame(object: number): void {
    this.change({ ...this.selected, object });
  }

  /** Selects both, as a link names them. */
  select(selected: Selected): void {
    this.change(selected);
  }

  selectFrame(frame: number): void {
    this.change({ ...this.selected, frame });
  }

  /** Calls `listener` after every change. */
  onChange(listener: (now: Selected, before: Selected) => void): void {
    this.listeners.push(listener);
  }

  private change(now: Selected): void {
    const before = this.selected;
    if (now.object === before.object && now.frame === before.frame) return;
    this.selected = now;
    for (const listener of this.listeners) listener(now, before);
  }
}
