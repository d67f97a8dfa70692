// The tapes that are sold everywhere, by name, and the labels that are painted on frames.
export const tapeNames = ['orange', 'cyan', 'red', 'green', 'blue', 'yellow', 'purple', 'pink'];

/** Labels that are not tape, as annotations.json names them. Tools without tape have the label `shaft`. */
export const NOT_TAPE = ['background', 'shaft', 'jaw', 'glove', 'other'];

/** Bright enough over any frame, and distinct from each other; the text beside them carries the meaning. */
const OVER_FRAMES = ['#ff2bd6', '#00e5ff', '#b6ff00', '#ffd400', '#ff6a00', '#8f7bff', '#00ff95', '#ffffff'];
const NO_TOOL = '#2f6bff';

/** The colour of a label's marks and mask over a frame. */
export const inkOf = (label, colours) => OVER_FRAMES[colours.indexOf(label) % OVER_FRAMES.length] ?? NO_TOOL;
