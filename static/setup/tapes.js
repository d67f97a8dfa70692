// The tapes that are sold everywhere, by name, and what is painted over frames.
export const tapeNames = ['orange', 'cyan', 'red', 'green', 'blue', 'yellow', 'purple', 'pink'];

/** Labels that are not tape, as annotations.json names them. */
export const NOT_TAPE = ['background', 'shaft', 'jaw', 'glove', 'other'];

/** Bright enough over any frame, and far from each other; the words beside them carry the meaning. */
const OVER_FRAMES = ['#ff2bd6', '#00e5ff', '#b6ff00', '#ffd400', '#ff6a00', '#8f7bff', '#00ff95', '#ffffff'];
const NO_TAPE = '#2f6bff';

/** The colour in which a label's marks and its mask are drawn over a frame. */
export const inkOf = (label, tapes) => OVER_FRAMES[tapes.indexOf(label) % OVER_FRAMES.length] ?? NO_TAPE;
