// x, y, z and speed over time, one curve per tool, with a playhead at the time of the video. Clicking or dragging goes
// there; with Shift it marks a span. Trimmed parts are shaded; another session's curves lie under these, in time with
// them.
import { html, useEffect, useRef, useState } from '../../preact.js';
import { onThemeChange } from '../../theme.js';
import { clock, exact } from '../../format.js';
import { t } from '../../texts.js';
import { curves } from './curves.js';
import { textColours } from './overlay.js';

const words = t.session;
const AXES = [
  ['x', 'x_mm'],
  ['y', 'y_mm'],
  ['z', 'z_mm'],
  ['speed', 'speed'],
];
const HEIGHT = 132;
/** How close to the ends of the shown span the playhead may come, as a share of the span. */
const EDGE_SHARE = 0.1;
/** From here on the axis shows minutes. */
const MINUTES_FROM_S = 120;
/** Pixels that a label of the time axis needs, below an hour and from an hour on. */
const LABEL_PX = [50, 72];

/**
 * `kept`: the seconds that trims leave, or null. `loader` loads the exact rows of the shown span.
 *
 * @param {Props} props
 */
export function Plots({ track, playback, hidden, span, kept, ghost, loader }) {
  const containers = useRef(/** @type {Record<string, HTMLElement>} */ ({}));
  const [uPlot, setLibrary] = useState(null);
  const [theme, setTheme] = useState(0);
  useEffect(() => void import('../../vendor/uplot/uPlot.esm.js').then(module => setLibrary(() => module.default)), []);
  useEffect(() => onThemeChange(() => setTheme(n => n + 1)), []);

  useEffect(() => {
    if (!uPlot) return undefined;
    const shown = { track, playback, span, kept, ghost, loader, tools: track.tools.filter(tool => !hidden.has(tool.name)) };
    const plots = [];
    let [pending, filled] = [0, 0];
    // One plot is made, or its curves drawn, per animation frame: four at once would block the page.
    const next = () => {
      const [name, field] = AXES[filled];
      if (filled < plots.length) updatePlot(plots[filled++], shown);
      else plots.push(makePlot(uPlot, containers.current[name], field, shown));
      pending = filled < AXES.length ? requestAnimationFrame(next) : 0;
    };
    pending = requestAnimationFrame(next);
    const resize = new ResizeObserver(() =>
      plots.forEach(plot => plot.chart.setSize({ width: plot.container.clientWidth, height: HEIGHT })),
    );
    resize.observe(containers.current.x);
    const unsubscribe = playback.onTick(() => plots.forEach(plot => updatePlot(plot, shown)));
    return () => {
      cancelAnimationFrame(pending);
      unsubscribe();
      resize.disconnect();
      plots.forEach(plot => plot.end());
    };
  }, [uPlot, theme, track, hidden, span, ghost, kept?.from_s, kept?.to_s]);

  return html`
    <div class="plots">
      ${AXES.map(([name]) => html`
          <div key=${name} class="plot" role="img" aria-label=${words.plotName(words.axis[name])}>
            <div class="title" aria-hidden="true">${words.axis[name]}</div>
            ${name === 'speed' && track.topSpeed === null && html`<p class="untold small muted">${words.noSpeed}</p>`}
            <div ref=${element => (containers.current[name] = element)}></div>
          </div>`)}
    </div>`;
}

function makePlot(uPlot, container, field, shown) {
  const { track, tools, ghost, playback } = shown;
  const { muted, line } = textColours();
  const axis = {
    stroke: muted,
    grid: { stroke: line, width: 1 },
    ticks: { stroke: line, width: 1, size: 4 },
    font: '12px system-ui, sans-serif',
  };
  const isLast = field === 'speed';
  const hasNoSpeed = isLast && track.topSpeed === null; // Its time axis stays aligned with those above.
  const chart = new uPlot(
    {
      width: Math.max(container.clientWidth, 50),
      height: HEIGHT,
      padding: [16, 18, isLast ? 0 : 4, 0], // On the right, space for half of the last label.
      legend: { show: false },
      hooks: { draw: [drawn => placeMarkers(drawn, shown)] }, // At first, and after every change of size or span.
      cursor: { drag: { x: false, y: false }, points: { show: false }, y: false },
      select: { show: false },
      scales: { x: { time: false, range: (_, low, high) => [low, high] }, ...(hasNoSpeed && { y: { range: [0, 1] } }) },
      axes: [
        {
          ...axis,
          show: true,
          size: isLast ? 30 : 6,
          space: (_, __, ___, last) => LABEL_PX[last < 3600 ? 0 : 1],
          values: isLast ? (_, all, __, ___, step) => timesOf(all, step) : (_, all) => all.map(() => ''),
        },
        { ...axis, size: 56, space: 26, values: (_, all) => all.map(hasNoSpeed ? () => '' : exact), ...(hasNoSpeed && { grid: { show: false }, ticks: { show: false } }) },
      ],
      series: [{}, ...(ghost ? tools.map(ghostStroke) : []), ...tools.flatMap(tool => [stroke(tool, false), stroke(tool, true)])],
    },
    [[track.times[0], track.times[track.frames - 1]], ...tools.flatMap(() => (ghost ? [[], [], []] : [[], []]))],
    container,
  );
  const parts = ['trimmed before', 'trimmed after', 'marked', 'playhead'].map(name =>
    Object.assign(document.createElement('div'), { className: name, hidden: true }),
  );
  chart.over.append(...parts);
  const plot = { chart, container, field, drawn: null, end: connect(chart, playback) };
  placeMarkers(chart, shown);
  return plot;
}

/** With as many digits as the step has: with fewer, neighbours would read alike. */
function timesOf(all, step) {
  if (all[all.length - 1] < MINUTES_FROM_S) return all.map(value => `${exact(Number(value.toFixed(3)))} s`);
  const digits = (String(step).split('.')[1] ?? '').length;
  return all.map(value => clock(value, digits));
}

const stroke = (tool, dashed) => ({
  stroke: tool.ink(),
  width: 1.75,
  dash: dashed ? [5, 4] : undefined,
  spanGaps: false,
  points: { show: false },
});

/** The other session's curve: broad and pale. */
const ghostStroke = tool => ({ stroke: tool.ink(), alpha: 0.3, width: 3.5, spanGaps: false, points: { show: false } });

/** From the pointer to the time. Capturing the pointer lets a drag leave the curve without losing it. */
function connect(chart, playback) {
  const { over } = chart;
  const secondOf = event => chart.posToVal(event.clientX - over.getBoundingClientRect().left, 'x');
  let from = null;
  const down = event => {
    if (event.button !== 0) return;
    over.setPointerCapture(event.pointerId);
    playback.pause();
    from = event.shiftKey ? secondOf(event) : null;
    if (from === null) playback.seek(secondOf(event));
  };
  const move = event => {
    if (!over.hasPointerCapture(event.pointerId)) return;
    if (from === null) return playback.seek(secondOf(event));
    const to = secondOf(event);
    playback.mark(Math.min(from, to), Math.max(from, to));
  };
  over.addEventListener('pointerdown', down);
  over.addEventListener('pointermove', move);
  return () => chart.destroy();
}

/**
 * Moves the playhead; with a span, also the shown part of the time axis and what is drawn in it. Without one,
 * everything is drawn once.
 */
function updatePlot(plot, shown) {
  const { track, playback, span, tools, ghost, loader } = shown;
  const { chart } = plot;
  const { time } = playback;
  placeMarkers(chart, shown);
  if (!span) {
    if (plot.drawn === null) chart.setData(curves(track, tools, plot.field, { ghost }));
    plot.drawn = track.version;
    return;
  }
  const [first, last] = [track.times[0], track.times[track.times.length - 1]];
  const { min, max } = chart.scales.x;
  const near = time > min + span * EDGE_SHARE && time < max - span * EDGE_SHARE;
  const start = Math.min(Math.max(first, time - span / 2), Math.max(first, last - span));
  // The view changes like a page, not at every picture: drawing the curves again costs more than anything else here.
  const mustRedraw = plot.drawn === null || max - min > span * 1.01 || (!near && min !== start);
  if (!mustRedraw && plot.drawn === track.version) return;
  const from = mustRedraw ? start : min;
  const to = Math.min(from + span, last);
  loader?.request(from, to);
  plot.drawn = track.version;
  chart.setData(curves(track, tools, plot.field, { ghost, within: [from, to] }), false);
  chart.setScale('x', { min: from, max: to });
}

/** Places the marked stretch, the trimmed parts and the playhead. */
function placeMarkers(chart, { track, playback, kept }) {
  const parts = chart.over.querySelectorAll(':scope > .trimmed, :scope > .marked, :scope > .playhead');
  if (!parts.length) return; // uPlot draws once before the elements are added.
  const { min, max } = chart.scales.x;
  const cover = (part, span) => {
    const [from, to] = span ? [Math.max(span[0], min), Math.min(span[1], max)] : [0, 0];
    part.hidden = !(to > from);
    if (part.hidden) return;
    const [left, right] = [from, to].map(second => chart.valToPos(second, 'x'));
    Object.assign(part.style, { left: `${left}px`, width: `${Math.max(2, right - left)}px` });
  };
  const [before, after, mark, head] = parts;
  cover(before, kept && [-Infinity, kept.from_s]);
  cover(after, kept && [kept.to_s, Infinity]);
  cover(mark, playback.marked);
  const within = Math.min(Math.max(playback.time, track.times[0]), track.times[track.times.length - 1]);
  head.hidden = within < min || within > max;
  if (!head.hidden) head.style.transform = `translateX(${chart.valToPos(within, 'x')}px)`;
}
