// The tips in space as they move, each with the path of its last seconds and a plumb line to the floor.
import { html, useEffect, useMemo, useRef } from '../../preact.js';
import { colour, onThemeChange } from '../../theme.js';
import { t } from '../../texts.js';
import { connectOrbit, Orbit, VIEWS } from '../playback/orbit.js';
import { fitCanvas } from '../playback/overlay.js';
import { drawFloor, drawPath, drawTip } from '../playback/space_painter.js';
import { MISSING } from '../playback/track.js';

const words = t.session;
const ZOOM = 1.1; // Moving tips are easier to follow when large; they seldom reach the corners of their space.
const FADE_ALPHAS = [0.15, 0.3, 0.5, 0.75, 1]; // From the oldest part of a path to the newest.

/** @param {Props} props */
export function LiveSpace({ watch }) {
  const canvas = useRef(null);
  const orbit = useMemo(() => new Orbit(ZOOM), []);
  const draw = useRef(() => {});
  useEffect(() => {
    let pending = 0;
    const paintNow = () => watch.track && paint(canvas.current, watch.track, orbit);
    const repaintSoon = () => (pending ||= requestAnimationFrame(() => ((pending = 0), paintNow())));
    draw.current = repaintSoon;
    const resize = new ResizeObserver(repaintSoon);
    resize.observe(canvas.current);
    const cleanups = [
      watch.onTick(paintNow), // Runs in a repaint already.
      connectOrbit(canvas.current, orbit, repaintSoon),
      onThemeChange(repaintSoon),
      () => resize.disconnect(),
      () => cancelAnimationFrame(pending),
    ];
    return () => cleanups.forEach(cleanup => cleanup());
  }, [watch]);
  const showView = view => {
    orbit.setView(view);
    draw.current();
  };
  return html`
    <section class="card space-card">
      <header>
        <h2>${t.watch.space}</h2>
        <div class="row" role="group" aria-label=${words.space}>
          ${Object.entries(VIEWS).map(([name, view]) => html`<button key=${name} class="button" type="button"
            onClick=${() => showView(view)}>${words.views[name]}</button>`)}
        </div>
      </header>
      <div class="space"><canvas ref=${canvas} tabindex="0" role="img" aria-label=${words.spaceName}
        title=${words.spaceHint}></canvas></div>
    </section>`;
}

function paint(canvas, track, orbit) {
  const { pen, width, height } = fitCanvas(canvas);
  if (!width) return;
  const project = orbit.projection(track.bounds, width, height);
  pen.lineCap = pen.lineJoin = 'round';
  drawFloor(pen, track.bounds, project);
  for (const tool of track.tools) drawFading(pen, track, tool, project);
  for (const tool of track.tools) drawPlumb(pen, track, tool, project);
  for (const tool of track.tools) drawTip(pen, tool, track.last, project);
}

function drawFading(pen, track, tool, project) {
  const rows = track.frames - track.first;
  FADE_ALPHAS.forEach((alpha, part) => {
    const [from, to] = [part, part + 1].map(at => track.first + Math.floor((rows * at) / FADE_ALPHAS.length));
    pen.globalAlpha = alpha;
    drawPath(pen, track, tool, project, { from: Math.max(track.first, from - 1), to }); // The parts join.
  });
  pen.globalAlpha = 1;
}

/** Shows where the tip is over the floor: on a flat screen, nothing else shows the depth. */
function drawPlumb(pen, { last, bounds }, tool, project) {
  if (last < 0 || tool.state[last] === MISSING || !Number.isFinite(tool.x_mm[last])) return;
  const [x, y, z] = [tool.x_mm[last], tool.y_mm[last], tool.z_mm[last]];
  const foot = project(x, y, bounds.ends[2][1]);
  pen.strokeStyle = pen.fillStyle = colour('--line-strong');
  pen.lineWidth = 1;
  pen.setLineDash([3, 4]);
  pen.beginPath();
  pen.moveTo(...project(x, y, z));
  pen.lineTo(...foot);
  pen.stroke();
  pen.setLineDash([]);
  pen.beginPath();
  pen.arc(foot[0], foot[1], 2.5, 0, 2 * Math.PI);
  pen.fill();
}
