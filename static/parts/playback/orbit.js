// A small view into space: rotate, zoom, project. The camera frame's x points right, its depth z down and y towards the
// viewer, so that the box is upright as the trainee sees it, and the view "camera" looks straight down into
// it.
export const VIEWS = { camera: [0, Math.PI / 2], front: [0, 0.35], side: [Math.PI / 2, 0.35] };
const START = [0.6, 0.5];
const DISTANCE = 3.2;
const MARGIN = 24; // Pixels left free on each side.

export class Orbit {
  /** Angles of the view, rad. */
  yaw = START[0];
  pitch = START[1];

  /** `zoom`: at first and after a reset. */
  constructor(zoom = 1) {
    this.start = zoom;
    this.reset();
  }

  reset() {
    [this.yaw, this.pitch] = START;
    this.zoom = this.start;
  }

  setView([yaw, pitch]) {
    [this.yaw, this.pitch] = [yaw, pitch];
  }

  rotate(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, this.pitch + pitch));
  }

  scale(factor) {
    this.zoom = Math.min(12, Math.max(0.4, this.zoom * factor));
  }

  /** A function from a point in mm to `[x, y, nearness]` on a canvas of that size. */
  projection(bounds, width, height) {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const [x, y, z] = bounds.ends.map(([low, high]) => (high - low) / 2);
    // Rotation about the vertical sweeps a circle: a cylinder that fits at this pitch, with space for labels, fits at
    // any yaw.
    const across = Math.hypot(x, y);
    // Near points appear larger.
    const perspectiveScale = towardsUs => DISTANCE / (DISTANCE - towardsUs / bounds.radius);
    const rims = [-across, across].flatMap(away => [-z, z].map(up => (up * cp + away * sp) * perspectiveScale(up * sp - away * cp)));
    const [below, above] = [-Math.min(...rims), Math.max(...rims)];
    const fit = Math.min((width / 2 - MARGIN) / (across * perspectiveScale(z * Math.abs(sp))), (height - 2 * MARGIN) / (below + above));
    const size = this.zoom * Math.max(fit, 0.1);
    const middle = height / 2 + (size * (above - below)) / 2;
    return (px, py, pz) => {
      const [right, near, up] = [px - bounds.centre[0], py - bounds.centre[1], bounds.centre[2] - pz];
      const aside = right * cy - near * sy;
      const away = -(right * sy + near * cy);
      const raised = up * cp + away * sp;
      const depth = away * cp - up * sp;
      const bigger = DISTANCE / (DISTANCE + depth / bounds.radius);
      return [width / 2 + aside * size * bigger, middle - raised * size * bigger, -depth];
    };
  }
}

/** Connects mouse, pen, one or two fingers, wheel and keys. Returns a function that disconnects them. */
export function connectOrbit(canvas, orbit, onChange) {
  const fingers = new Map();
  let spread = 0;
  const fingerDistance = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  const handlers = {
    pointerdown(event) {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      if (fingers.size === 2) spread = fingerDistance();
    },
    pointermove(event) {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      if (fingers.size === 1) orbit.rotate((event.clientX - before[0]) * 0.01, (event.clientY - before[1]) * 0.01);
      if (fingers.size === 2) {
        orbit.scale(fingerDistance() / (spread || 1));
        spread = fingerDistance();
      }
      onChange();
    },
    pointerup: event => fingers.delete(event.pointerId),
    pointercancel: event => fingers.delete(event.pointerId),
    wheel(event) {
      event.preventDefault();
      orbit.scale(Math.exp(-event.deltaY * 0.001));
      onChange();
    },
    keydown(event) {
      const keys = {
        ArrowLeft: () => orbit.rotate(-0.1, 0),
        ArrowRight: () => orbit.rotate(0.1, 0),
        ArrowUp: () => orbit.rotate(0, -0.1),
        ArrowDown: () => orbit.rotate(0, 0.1),
        '+': () => orbit.scale(1.15),
        '=': () => orbit.scale(1.15),
        '-': () => orbit.scale(1 / 1.15),
        0: () => orbit.reset(),
      };
      if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      event.stopPropagation(); // Here the arrow keys rotate the path; elsewhere on the page they move in time.
      keys[event.key]();
      onChange();
    },
  };
  for (const [name, handler] of Object.entries(handlers)) canvas.addEventListener(name, handler, { passive: false });
  return () => Object.entries(handlers).forEach(([name, handler]) => canvas.removeEventListener(name, handler));
}
