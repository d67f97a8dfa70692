// What the photos so far lack: areas of the picture without corners, and sides that the board was never tilted to. It
// is advice for the next photo, not a measure of the camera: the calibration gives that.
export const MIN_PHOTOS = 3;
export const WANTED_PHOTOS = 12;
const AREAS = { columns: ['left', 'middle', 'right'], rows: ['top', 'middle', 'bottom'] };
export const TILTS = ['left', 'right', 'top', 'bottom'];

/** `cells`: corners of all photos in each cell; `missing`: areas `[row, column]`; `tilts`: photos by nearer side. */
export function needsOf(good) {
  const coverage = good[0]?.check.coverage;
  const cells = coverage ? coverage.corners.map((_, cell) => sum(good, ({ check }) => check.coverage.corners[cell])) : [];
  const tilts = Object.fromEntries(TILTS.map(side => [side, good.filter(({ check }) => check.near === side).length]));
  const missing = coverage ? missingAreas(cells, coverage) : [];
  const untilted = TILTS.filter(side => tilts[side] === 0);
  const more = Math.max(0, WANTED_PHOTOS - good.length);
  return { coverage, cells, missing, tilts, untilted, more, isEnough: good.length > 0 && !more && !missing.length };
}

/** A ninth of the picture is missing if less than half of its cells hold a corner. */
function missingAreas(cells, { columns, rows }) {
  const areas = [];
  AREAS.rows.forEach((row, down) =>
    AREAS.columns.forEach((column, across) => {
      const own = cells.filter(
        (_, cell) =>
          Math.floor((3 * (cell % columns)) / columns) === across &&
          Math.floor((3 * Math.floor(cell / columns)) / rows) === down,
      );
      if (own.filter(count => count > 0).length * 2 < own.length) areas.push([row, column]);
    }),
  );
  return areas;
}

const sum = (items, valueOf) => items.reduce((total, item) => total + valueOf(item), 0);
