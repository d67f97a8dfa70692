// x, y, z and speed over time, one curve per tool, with a line at the moment of the video. Click or drag goes there.
import { html, useEffect, useRef, useState } from './preact.js';
import { onThemeChange } from '../theme.js';
import { number } from '../format.js';
import { t } from '../texts.js';
import { inkOf } from './overlay.js';
import { curveFrames, MISSING, OBSERVED, PREDICTED } from './track.js';

const words = t.session;
const AXES = [
  ['x', 'x_mm'],
  ['y', 'y_mm'],
  ['z', 'z_mm'],
  ['speed', 'speed'],
];
const HEIGHT = 132;
/** How close to the ends of the shown span the line may come, as a share of the span. */
const EDGE = 0.1;

export function Plots({ track, playback, hidden, span }) {
  const places = useRef({});
  const [uPlot, setLibrary] = useState(null);
  const [theme, setTheme] = useState(0);
  useEffect(() => void import('../vendor/uplot/uPlot.esm.js').then(module => setLibrary(() => module.default)), []);
  useEffect(() => onThemeChange(() => setTheme(n => n + 1)), []);

  useEffect(() => {
    if (!uPlot) return undefined;
    const plots = AXES.map(([name, field]) => makePlot(uPlot, places.current[name], track, field, hidden, playback));
    const resize = new ResizeObserver(() =>
      plots.forEach(plot => plot.chart.setSize({ width: plot.place.clientWidth, height: HEIGHT })),
    );
    resize.observe(places.current.x);
    const follow = playback.onTick(() => plots.forEach(plot => turnPage(plot, track, playback, span)));
    return () => {
      follow();
      resize.disconnect();
      plots.forEach(plot => plot.end());
    };
  }, [uPlot, theme, track, hidden, span]);

  return html`
    <div class="plots">
      ${AXES.map(([name]) => html`
          <div key=${name} class="plot" role="img" aria-label=${words.plotName(words.axis[name])}>
            <div class="title" aria-hidden="true">${words.axis[name]}</div>
            <div ref=${element => (places.current[name] = element)}></div>
          </div>`)}
    </div>`;
}

function makePlot(uPlot, place, track, field, hidden, playback) {
  const tools = track.tools.filter(tool => !hidden.has(tool.name));
  const { muted, line } = inkOf();
  const axis = {
    stroke: muted,
    grid: { stroke: line, width: 1 },
    ticks: { stroke: line, width: 1, size: 4 },
    font: '12px system-ui, sans-serif',
  };
  const isLast = field === 'speed';
  const chart = new uPlot(
    {
      width: Math.max(place.clientWidth, 50),
      height: HEIGHT,
      padding: [16, 8, isLast ? 0 : 4, 0],
      legend: { show: false },
      hooks: { draw: [chart => placeHead(chart, track, playback)] }, // At first, and after every change of size or span.
      cursor: { drag: { x: false, y: false }, points: { show: false }, y: false },
      select: { show: false },
      scales: { x: { time: false, range: (_, low, high) => [low, high] } },
      axes: [
        {
          ...axis,
          show: true,
          size: isLast ? 30 : 6,
          values: isLast
            ? (_, all) => all.map(value => `${number(value)} s`.replace(/\.00? s/, ' s'))
            : (_, all) => all.map(() => ''),
        },
        { ...axis, size: 56, space: 26, values: (_, all) => all.map(value => String(value).replace('-', '−')) },
      ],
      series: [{}, ...tools.flatMap(tool => [stroke(tool, false), stroke(tool, true)])],
    },
    curves(track, tools, field),
    place,
  );
  const head = document.createElement('div');
  head.className = 'playhead';
  const mark = document.createElement('div');
  mark.className = 'marked';
  mark.hidden = true;
  chart.over.append(mark, head);
  placeHead(chart, track, playback);
  return { chart, place, end: connect(chart, playback) };
}

const stroke = (tool, dashed) => ({
  stroke: tool.ink(),
  width: 1.75,
  dash: dashed ? [5, 4] : undefined,
  spanGaps: false,
  points: { show: false },
});

/** Times, and of each tool what was observed and what was predicted; nothing where frames miss. */
function curves(track, tools, field) {
  const frames = curveFrames(track);
  const timeOf = (frame, at) => track.times[frame] ?? (track.times[frames[at - 1]] + track.times[frames[at + 1]]) / 2;
  const of = values => frames.map(frame => (frame === null ? null : values[frame]));
  return [frames.map(timeOf), ...tools.flatMap(tool => split(tool, tool[field]).map(of))];
}

/** Observed and predicted apart; a predicted stretch takes in its neighbours, so that the curve does not break where nothing is missing. */
function split(tool, values) {
  const observed = Array.from(values, (value, i) =>
    tool.state[i] === OBSERVED && Number.isFinite(value) ? value : null,
  );
  const touches = i => tool.state[i - 1] === PREDICTED || tool.state[i + 1] === PREDICTED;
  const predicted = Array.from(values, (value, i) => {
    const wanted = tool.state[i] === PREDICTED || (tool.state[i] !== MISSING && touches(i));
    return wanted && Number.isFinite(value) ? value : null;
  });
  return [observed, predicted];
}

/** Pointer → time. Capturing the pointer lets a drag leave the curve without losing it. */
function connect(chart, playback) {
  const { over } = chart;
  const seek = event => playback.seek(chart.posToVal(event.clientX - over.getBoundingClientRect().left, 'x'));
  const down = event => {
    if (event.button !== 0) return;
    over.setPointerCapture(event.pointerId);
    playback.pause();
    seek(event);
  };
  const move = event => over.hasPointerCapture(event.pointerId) && seek(event);
  over.addEventListener('pointerdown', down);
  over.addEventListener('pointermove', move);
  return () => chart.destroy();
}

/** Moves the line; with a span, also the part of the time axis that is shown. */
function turnPage({ chart }, track, playback, span) {
  const { time } = playback;
  placeHead(chart, track, playback);
  if (!span) return;
  const [first, last] = [track.times[0], track.times[track.times.length - 1]];
  const { min, max } = chart.scales.x;
  const near = time > min + span * EDGE && time < max - span * EDGE;
  const start = Math.min(Math.max(first, time - span / 2), Math.max(first, last - span));
  // Turned over like a page, not at every picture: drawing the curves anew costs more than anything else here.
  if (max - min > span * 1.01 || (!near && min !== start))
    chart.setScale('x', { min: start, max: Math.min(start + span, last) });
}

/** The stretch that one has gone to. */
function placeMark(chart, { marked }) {
  const mark = chart.over.querySelector('.marked');
  mark.hidden = !marked;
  if (!marked) return;
  const [left, right] = marked.map(second => chart.valToPos(second, 'x'));
  Object.assign(mark.style, { left: `${left}px`, width: `${Math.max(2, right - left)}px` });
}

function placeHead(chart, track, playback) {
  const head = chart.over.querySelector('.playhead');
  if (!head) return; // uPlot draws once before we have added the line.
  const within = Math.min(Math.max(playback.time, track.times[0]), track.times[track.times.length - 1]);
  head.style.transform = `translateX(${chart.valToPos(within, 'x')}px)`;
  placeMark(chart, playback);
}
