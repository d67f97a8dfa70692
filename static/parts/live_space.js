// The tips in space as they move, each with the path of its last seconds and a plumb line to the floor.
import { html, useEffect, useMemo, useRef } from './preact.js';
import { colour, onThemeChange } from '../theme.js';
import { t } from '../texts.js';
import { connectOrbit, Orbit, VIEWS } from './orbit.js';
import { fitCanvas } from './overlay.js';
import { drawFloor, drawPath, drawTip } from './space_painter.js';
import { MISSING } from './track.js';

const words = t.session;
const ZOOM = 1.1; // Moving tips are followed best large; the corners of their space are seldom visited.
const FADES = [0.15, 0.3, 0.5, 0.75, 1]; // From the oldest part of a path to the newest.

export function LiveSpace({ watch }) {
  const canvas = useRef(null);
  const orbit = useMemo(() => new Orbit(ZOOM), []);
  const draw = useRef(() => {});
  useEffect(() => {
    let pending = 0;
    const now = () => watch.track && paint(canvas.current, watch.track, orbit);
    const soon = () => (pending ||= requestAnimationFrame(() => ((pending = 0), now())));
    draw.current = soon;
    const resize = new ResizeObserver(soon);
    resize.observe(canvas.current);
    const ends = [
      watch.onTick(now), // It is a repaint already.
      connectOrbit(canvas.current, orbit, soon),
      onThemeChange(soon),
      () => resize.disconnect(),
      () => cancelAnimationFrame(pending),
    ];
    return () => ends.forEach(end => end());
  }, [watch]);
  const look = view => {
    orbit.look(view);
    draw.current();
  };
  return html`
    <section class="card space-card">
      <header>
        <h2>${t.watch.space}</h2>
        <div class="row" role="group" aria-label=${words.space}>
          ${Object.entries(VIEWS).map(([name, view]) => html`<button key=${name} class="button" type="button"
            onClick=${() => look(view)}>${words.views[name]}</button>`)}
        </div>
      </header>
      <div class="space"><canvas ref=${canvas} tabindex="0" role="img" aria-label=${words.spaceName}
        title=${words.spaceHint}></canvas></div>
    </section>`;
}

function paint(canvas, track, orbit) {
  const { pen, width, height } = fitCanvas(canvas);
  if (!width) return;
  const place = orbit.projection(track.bounds, width, height);
  pen.lineCap = pen.lineJoin = 'round';
  drawFloor(pen, track.bounds, place);
  for (const tool of track.tools) drawFading(pen, track, tool, place);
  for (const tool of track.tools) drawPlumb(pen, track, tool, place);
  for (const tool of track.tools) drawTip(pen, tool, track.last, place);
}

function drawFading(pen, track, tool, place) {
  const rows = track.frames - track.first;
  FADES.forEach((alpha, part) => {
    const [from, to] = [part, part + 1].map(at => track.first + Math.floor((rows * at) / FADES.length));
    pen.globalAlpha = alpha;
    drawPath(pen, track, tool, place, { from: Math.max(track.first, from - 1), to }); // Parts join.
  });
  pen.globalAlpha = 1;
}

/** Where the tip is over the floor: on a flat screen depth is told by it alone. */
function drawPlumb(pen, { last, bounds }, tool, place) {
  if (last < 0 || tool.state[last] === MISSING || !Number.isFinite(tool.x_mm[last])) return;
  const [x, y, z] = [tool.x_mm[last], tool.y_mm[last], tool.z_mm[last]];
  const foot = place(x, y, bounds.ends[2][1]);
  pen.strokeStyle = pen.fillStyle = colour('--line-strong');
  pen.lineWidth = 1;
  pen.setLineDash([3, 4]);
  pen.beginPath();
  pen.moveTo(...place(x, y, z));
  pen.lineTo(...foot);
  pen.stroke();
  pen.setLineDash([]);
  pen.beginPath();
  pen.arc(foot[0], foot[1], 2.5, 0, 2 * Math.PI);
  pen.fill();
}
