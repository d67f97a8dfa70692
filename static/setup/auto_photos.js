// Photos of the board that the page takes by itself, while both hands hold the board: one whenever the board is found, is
// held still, and has moved since the photos before.

/** How far the corners may move between two looks for a board that is held still, share of the picture's width. */
const STILL = 0.004;
/** How far they must have moved since every photo before, share of the picture's width: about a third of a square. */
const MOVED = 0.03;
/** A pause between two looks, ms: the service checks photos of others as well. */
const PAUSE_MS = 400;

/** Mean distance between the corners of two checks, share of the picture's width; infinite if they are not comparable. */
export function shift(one, other) {
  if (!one || !other || one.width !== other.width || one.corners.length !== other.corners.length) return Infinity;
  const distance = one.corners.reduce((sum, [x, y], at) => sum + Math.hypot(x - other.corners[at][0], y - other.corners[at][1]), 0);
  return distance / one.corners.length / one.width;
}

/**
 * What the page does with a look at the board: `search`, `still` (hold still), `move` (it is as in an earlier photo) or
 * `take`.
 *
 * @param {Schemas['PhotoCheck']} check
 * @param {Schemas['PhotoCheck'] | undefined} before the look before
 * @param {Schemas['PhotoCheck'][]} taken
 */
export function verdictOn(check, before, taken) {
  if (!check.found) return 'search';
  if (taken.some(other => shift(check, other) < MOVED)) return 'move';
  return before?.found && shift(check, before) < STILL ? 'take' : 'still';
}

/**
 * Looks at the board until `signal` is aborted. `look()` gives a picture and its check, or null without one;
 * `taken()` the checks of the photos so far; `onVerdict(verdict, picture, check)` is awaited.
 */
export async function watchBoard({ look, taken, onVerdict, signal }) {
  let before;
  while (!signal.aborted) {
    const seen = document.hidden ? null : await look();
    if (signal.aborted) return;
    if (seen) {
      const verdict = verdictOn(seen.check, before, taken());
      before = verdict === 'take' ? undefined : seen.check;
      await onVerdict(verdict, seen.blob, seen.check);
    }
    await new Promise(resolve => setTimeout(resolve, PAUSE_MS));
  }
}
