// The paths of the tips in space, coloured by speed or by tool, with the current tips. Rotates with mouse, touch and
// keys.
import { html, useEffect, useMemo, useRef, useState } from '../../preact.js';
import { number } from '../../format.js';
import { onThemeChange } from '../../theme.js';
import { t } from '../../texts.js';
import { connectOrbit, Orbit, VIEWS } from './orbit.js';
import { SpacePainter } from './space_painter.js';

const words = t.session;

/** @param {Props} props */
export function Path3d({ track, playback, hidden, ghost }) {
  const canvas = useRef(null);
  const orbit = useMemo(() => new Orbit(), []);
  const ways = track.topSpeed === null ? ['tool'] : ['speed', 'tool'];
  const [by, setBy] = useState(ways[0]);
  const draw = useRef(() => {});

  useEffect(() => {
    const tools = track.tools.filter(tool => !hidden.has(tool.name));
    const painter = new SpacePainter(track, tools, by, ghost);
    let pending = 0;
    const paint = () => {
      pending = 0;
      if (canvas.current) painter.paint(canvas.current, orbit, playback.frame);
    };
    const repaintAll = () => (painter.invalidate(), repaintSoon());
    const repaintSoon = () => (pending ||= requestAnimationFrame(paint)); // Many changes, one painting per repaint.
    draw.current = repaintSoon;
    const resize = new ResizeObserver(repaintSoon);
    resize.observe(canvas.current);
    const cleanups = [
      playback.onTick(repaintSoon),
      connectOrbit(canvas.current, orbit, repaintSoon),
      onThemeChange(repaintAll),
      () => resize.disconnect(),
      () => cancelAnimationFrame(pending),
    ];
    return () => cleanups.forEach(cleanup => cleanup());
  }, [track, hidden, by, ghost]);

  const showView = view => {
    orbit.setView(view);
    draw.current();
  };
  return html`
    <div class="space stack tight">
      <canvas ref=${canvas} tabindex="0" role="img" aria-label=${words.spaceName}></canvas>
      <div class="row apart">
        <div class="row" role="group" aria-label=${words.space}>
          ${Object.entries(VIEWS).map(([name, view]) => html`<button key=${name} class="button" type="button"
            onClick=${() => showView(view)}>${words.views[name]}</button>`)}
        </div>
        ${ways.length > 1 && html`<div class="row" role="group" aria-label=${words.colourBy}>
          ${ways.map(way => html`<button key=${way} class="button" type="button" aria-pressed=${by === way}
            onClick=${() => setBy(way)}>${words.by[way]}</button>`)}
        </div>`}
      </div>
      ${by === 'speed' && html`<div class="scale"><span>${words.slow}</span><span class="ramp"></span><span>
        ${words.fast(number(track.topSpeed))}</span></div>`}
      <p class="small muted">${words.spaceHint}</p>
    </div>`;
}
