// The parts of the features table: the standard and the most used measures first, then each family in a fold with its
// number of features. A fold stays as the person left it, and a printout shows all.
import { html, useEffect, useState } from '../../preact.js';
import { t } from '../../texts.js';
import { isUninformative } from './feature_notes.js';

const words = t.session.folds;

/**
 * Time, path length, depth, motion smoothness and idle time: the measures with construct validity for 42 novices, residents
 * and experts whose instruments were tracked (Oropesa 2013, Surg. Innov. 20, 299–312; docs/method.md, section 6.3).
 */
export const MOST_USED = ['duration', 'path_length', 'depth_travelled', 'log_dimensionless_jerk', 'idle_share'];

/**
 * `[{ key, title, rows, isFirst }]`, each row in one part. A row that says nothing follows the others of its family. In
 * the image, what needs depth follows at the end.
 */
export function featureParts(rows, space) {
  const isDeep = row => space === 'image' && row.needsDepth;
  const hasLimit = row => [...row.byTool.values()].some(feature => feature.target);
  const isFirst = row => hasLimit(row) || (MOST_USED.includes(row.name) && !isDeep(row));
  const limited = rows.filter(hasLimit);
  const usual = MOST_USED.map(name => rows.find(row => row.name === name)).filter(row => row && isFirst(row) && !hasLimit(row));
  const others = rows.filter(row => !isFirst(row));
  const families = [...new Set(others.filter(row => !isDeep(row)).map(row => row.family))];
  return [
    { key: 'first', title: limited.length ? words.standardFirst : words.mostUsed, rows: [...limited, ...usual], isFirst: true },
    ...families.map(family => ({
      key: family ?? 'former',
      title: t.session.families[family ?? 'former'],
      rows: informativeFirst(others.filter(row => row.family === family && !isDeep(row))),
    })),
    { key: 'depth', title: t.session.comparedSpace.needDepth, rows: informativeFirst(others.filter(isDeep)) },
  ].filter(part => part.rows.length > 0);
}

/** Whether no tool's value of a row says anything. */
export const saysNothing = row => {
  const known = [...row.byTool.values()].filter(feature => feature.value !== null);
  return known.length > 0 && known.every(isUninformative);
};

const informativeFirst = rows => [...rows.filter(row => !saysNothing(row)), ...rows.filter(saysNothing)];

const KEY = 'trocar.folds';

/** Which folds are open: `isOpen(key, initially)` and `set({ key: isOpen })`, which the browser keeps. */
export function useFolds() {
  const [kept, setKept] = useState(readFolds);
  useEffect(showAllInPrint, []);
  const set = changes => {
    const next = { ...readFolds(), ...changes };
    setKept(next);
    try {
      localStorage.setItem(KEY, JSON.stringify(next));
    } catch {
      // The browser refuses storage: the folds stay as they are until the page is left.
    }
  };
  return { isOpen: (key, initially) => kept[key] ?? initially, set };
}

function readFolds() {
  try {
    return JSON.parse(localStorage.getItem(KEY) ?? '{}') ?? {};
  } catch {
    return {};
  }
}

/** Opens every fold while the page is printed. Before printing there is no time to draw anything again. */
function showAllInPrint() {
  let opened = [];
  const open = () => {
    opened = [.../** @type {NodeListOf<HTMLDetailsElement>} */ (document.querySelectorAll('details.fold:not([open])'))];
    opened.forEach(fold => (fold.open = true));
  };
  const close = () => opened.splice(0).forEach(fold => (fold.open = false));
  addEventListener('beforeprint', open);
  addEventListener('afterprint', close);
  return () => (removeEventListener('beforeprint', open), removeEventListener('afterprint', close));
}

/** A part of the table. The element decides whether it is open: searching in the page can open it, too. */
export function Fold({ part, folds, children }) {
  const toggle = event => {
    event.preventDefault();
    const fold = event.currentTarget.parentElement;
    fold.open = !fold.open;
    folds.set({ [part.key]: fold.open });
  };
  const uncertain = part.rows.filter(saysNothing).length;
  return html`
    <details class="fold" open=${folds.isOpen(part.key, Boolean(part.isFirst))}>
      <summary onClick=${toggle}><span>${part.title}</span> <small class="muted">${words.count(part.rows.length)}${
        uncertain > 0 && `, ${words.uncertain(uncertain)}`}</small></summary>
      ${children}
    </details>`;
}

/** Opens or closes all parts. */
export function FoldAll({ parts, folds }) {
  const all = isOpen => folds.set(Object.fromEntries(parts.map(part => [part.key, isOpen || Boolean(part.isFirst)])));
  const isAllOpen = parts.every(part => folds.isOpen(part.key, Boolean(part.isFirst)));
  return html`<button class="button" type="button" onClick=${() => all(!isAllOpen)}>${isAllOpen ? words.close : words.open}</button>`;
}
