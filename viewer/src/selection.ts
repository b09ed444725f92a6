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

  constructor(start: Selected) {
    this.selected = start;
  }

  get object(): number {
    return this.selected.object;
  }

  get frame(): number {
    return this.selected.frame;
  }

  /** Selects an object, or none with -1. */
  selectObject(object: number): void {
    this.change({ ...this.selected, object });
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
