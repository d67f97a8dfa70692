// The tapes that are sold everywhere, by name, and the labels that are painted on frames.
export const tapeNames = ['orange', 'cyan', 'red', 'green', 'blue', 'yellow', 'purple', 'pink'];

/** Labels that are not tape, as annotations.json names them. Tools without tape have the label `shaft`. */
export const NOT_TAPE = ['background', 'shaft', 'jaw', 'glove', 'other'];

/** The usual tapes in their own colours, as bright as a screen shows them: what is painted on the orange tape is orange. */
const OF_TAPES = {
  orange: '#ff8a1f',
  cyan: '#00e5ff',
  red: '#ff3b3b',
  green: '#4cff4c',
  blue: '#4f8dff',
  yellow: '#ffe600',
  purple: '#b56bff',
  pink: '#ff5fd2',
};
/** For other tapes and bare shafts: bright enough over any frame, and distinct; the text beside them carries the meaning. */
const OF_OTHERS = ['#b6ff00', '#ff2bd6', '#00ff95', '#ffffff'];
const NO_TOOL = '#2f6bff';

/** The colour of a label's marks and mask over a frame. */
export function inkOf(label, colours) {
  if (!colours.includes(label)) return NO_TOOL;
  const named = OF_TAPES[label.trim().toLowerCase()];
  const others = colours.filter(colour => !OF_TAPES[colour.trim().toLowerCase()]);
  return named ?? OF_OTHERS[others.indexOf(label) % OF_OTHERS.length];
}
