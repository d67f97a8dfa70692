// The data of the curves: times, and for each tool the observed and the predicted values; null where frames are
// missing.
import { curveFrames, frameAt, MISSING, OBSERVED, PREDICTED } from './track.js';

/**
 * Columns for uPlot: of the frames that determine the curve's shape, or of every frame `within` two times. `ghost`
 * comes first.
 *
 * @param {any} track
 * @param {any[]} tools
 * @param {string} field
 * @param {{ ghost?: any, within?: [number, number] }} options
 */
export function curves(track, tools, field, { ghost, within }) {
  const frames = curveFrames(track, within);
  const { times } = track;
  const timeOf = (frame, at) => times[frame] ?? (times[frames[at - 1]] + times[frames[at + 1]]) / 2;
  const seconds = frames.map(timeOf);
  const valuesWhere = (tool, isWanted) =>
    frames.map(frame => (frame === null || !isWanted(tool, frame) ? null : finite(tool[field][frame])));
  return [
    seconds,
    ...(ghost ? tools.map(tool => ghostCurve(ghost, tool, field, seconds)) : []),
    ...tools.flatMap(tool => [valuesWhere(tool, isObserved), valuesWhere(tool, isPredicted)]),
  ];
}

const finite = value => (Number.isFinite(value) ? value : null);
const isObserved = (tool, frame) => tool.state[frame] === OBSERVED;

/** A predicted stretch includes its neighbouring frames, so that the curve does not break where nothing is missing. */
function isPredicted({ state }, frame) {
  if (state[frame] !== OBSERVED) return state[frame] === PREDICTED;
  return state[frame - 1] === PREDICTED || state[frame + 1] === PREDICTED;
}

/** The values of the other session's tool of the same name at these times of this session. */
function ghostCurve({ track, shift }, { name }, field, seconds) {
  const tool = track.tools.find(other => other.name === name);
  const end = track.times[track.frames - 1];
  return seconds.map(second => {
    const time = second + shift;
    if (!tool || time < track.times[0] || time > end) return null;
    const frame = frameAt(track.times, time);
    return tool.state[frame] === MISSING ? null : finite(tool[field][frame]);
  });
}
