// A rater's open error sheet: large buttons to tap while watching, keys 1 to 9, typed amounts, and undo. Every tap is stored at
// once with its time in the recording; the sheet counts when it is finished.
import { html, useEffect, useRef, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem } from '../../data.js';
import { clock, number } from '../../format.js';
import { t } from '../../texts.js';
import { Confirm } from '../forms/dialog.js';
import { ProblemNotice } from '../page/notice.js';

const words = t.errors;
/** Items with a key of their own. */
const MAX_KEYS = 9;

/**
 * The marks of an open sheet. They are shown at once and stored one after the other, in the order of the taps.
 *
 * @param {string} session
 * @param {Schemas['ErrorSheetResponse']} sheet
 */
function useMarks(session, sheet) {
  const [marks, setMarks] = useState(() => sheet.marks.map(({ id, item, at_s: at }) => ({ key: String(id), item, at_s: at ?? null })));
  const [problem, setProblem] = useState(null);
  /** The ids of the stored marks by their keys. @type {{ current: Map<string, string> }} */
  const ids = useRef(new Map(sheet.marks.map(({ id }) => [String(id), String(id)])));
  const queue = useRef(Promise.resolve());
  const count = useRef(0);
  const store = (work, revert) => {
    queue.current = queue.current.then(work).catch(error => (revert(), setProblem(asProblem(error))));
    return queue.current;
  };
  const without = key => setMarks(before => before.filter(mark => mark.key !== key));
  const tap = (item, at) => {
    const mark = { key: `new ${count.current++}`, item, at_s: at };
    setMarks(before => [...before, mark]);
    return store(
      async () => void ids.current.set(mark.key, (await api.sessions.markError(session, { item, at_s: at })).id),
      () => without(mark.key),
    );
  };
  const undo = mark => {
    without(mark.key);
    return store(
      () => api.sessions.unmarkError(session, ids.current.get(mark.key) ?? ''),
      () => setMarks(before => [...before, mark]),
    );
  };
  return { marks, tap, undo, problem, dismiss: () => setProblem(null), stored: () => queue.current };
}

/**
 * `now()` is the time of the recording that is shown, or null. `goTo(seconds)` shows that time; null while the recording
 * arrives.
 *
 * @param {Props} props
 */
export function ErrorSheetForm({ session, sheet, now, goTo, onDone }) {
  const { marks, tap, undo, problem, dismiss, stored } = useMarks(session.id, sheet);
  const [typed, setTyped] = useState(() => typedOf(sheet));
  const [refused, setRefused] = useState(null);
  const [busy, setBusy] = useState(false);
  const [discarding, setDiscarding] = useState(false);
  const form = useRef(null);
  const press = item => {
    const marked = marks.find(mark => mark.item === item.item);
    if (item.kind === 'amount') return form.current.elements.namedItem(amountName(item))?.focus();
    if (item.kind === 'yes_no' && marked) return undo(marked);
    return tap(item.item, now());
  };
  useKeys(sheet.items, press);
  const saveTyped = () => api.sessions.setErrorValues(session.id, valuesOf(form.current, sheet.items));
  const keepTyped = () => (setTyped(typedIn(form.current, sheet.items)), saveTyped().then(() => setRefused(null), error => setRefused(asProblem(error))));
  const run = async work => {
    setBusy(true);
    setRefused(null);
    try {
      await stored();
      await work();
      return onDone();
    } catch (error) {
      setRefused(asProblem(error));
    }
    return setBusy(false);
  };
  const finish = event => {
    event.preventDefault();
    return run(async () => (await saveTyped(), await api.sessions.finishErrorSheet(session.id)));
  };
  const untyped = sheet.items.filter(item => item.kind === 'amount' && !typed[item.item]).map(item => item.name);
  const last = marks[marks.length - 1];
  return html`
    <form class="stack error-sheet" ref=${form} onSubmit=${finish}>
      <p class="small muted">${words.howTo}</p>
      <div class="taps">
        ${sheet.items.map((item, index) => html`<${Item} key=${item.item} item=${item} number=${index + 1}
          marks=${marks.filter(mark => mark.item === item.item)} value=${typed[item.item]} onPress=${() => press(item)} onTyped=${keepTyped} />`)}
      </div>
      <div class="field time-by-hand"><label for="time-by-hand">${words.timeByHand} <span class="muted">(${t.form.optional})</span></label>
        <input id="time-by-hand" type="number" name="time by hand" min="0.1" max="86400" step="any" defaultValue=${sheet.time_s ?? ''}
          onChange=${keepTyped} /></div>
      ${last && html`<div class="row apart"><${Marks} marks=${marks} items=${sheet.items} goTo=${goTo} onUndo=${undo} /></div>`}
      <${ProblemNotice} problem=${problem} onDismiss=${dismiss} />
      <${ProblemNotice} problem=${refused} onDismiss=${() => setRefused(null)} />
      ${untyped.length > 0 && html`<p class="small muted">${words.untyped(untyped)}</p>`}
      <div class="row">
        <button class="button main" type="submit" disabled=${busy}>${words.finish(marks.length)}</button>
        ${last && html`<button class="button" type="button" disabled=${busy} onClick=${() => undo(last)}>${words.undo}</button>`}
        <button class="button bare" type="button" disabled=${busy} onClick=${() => setDiscarding(true)}>${words.discard}</button>
      </div>
      ${discarding && html`<${Confirm} title=${words.discardTitle} body=${words.discardBody} yes=${words.discard}
        onClose=${() => setDiscarding(false)} onYes=${() => stored().then(() => api.sessions.discardErrorSheet(session.id)).then(onDone)} />`}
    </form>`;
}

/** Typed amounts by item, as text. @param {Schemas['ErrorSheetResponse']} sheet */
const typedOf = sheet => Object.fromEntries(sheet.items.filter(item => item.kind === 'amount').map(item => {
  const value = sheet.values.find(one => one.item === item.item)?.value ?? null;
  return [item.item, value === null ? '' : String(value)];
}));

const typedIn = (form, items) => Object.fromEntries(items.filter(item => item.kind === 'amount')
  .map(item => [item.item, form.elements.namedItem(amountName(item)).value]));

/** The name of an amount's input; a bare short name could be one of the form's own properties. */
const amountName = item => `amount ${item.item}`;

/** What was typed, for the service: an empty field is unknown, not zero. */
function valuesOf(form, items) {
  const amounts = Object.entries(typedIn(form, items)).filter(([, text]) => text !== '').map(([item, text]) => [item, Number(text)]);
  const time = form.elements.namedItem('time by hand').value;
  return { amounts: Object.fromEntries(amounts), time_s: time === '' ? undefined : Number(time) };
}

/** Keys 1 to 9 press the items, unless something is being typed. */
function useKeys(items, press) {
  const latest = useRef(press);
  latest.current = press;
  useEffect(() => {
    const handle = event => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || document.querySelector('dialog[open]')) return;
      if (event.target.closest?.('input:not([type="range"]), select, textarea')) return;
      const item = items.slice(0, MAX_KEYS)[Number(event.key) - 1];
      if (!item) return;
      event.preventDefault();
      latest.current(item);
    };
    document.addEventListener('keydown', handle);
    return () => document.removeEventListener('keydown', handle);
  }, [items]);
}

/** @param {Props} props */
function Item({ item, number: place, marks, value, onPress, onTyped }) {
  const key = place <= MAX_KEYS ? html`<kbd aria-hidden="true">${place}</kbd>` : null;
  if (item.kind === 'amount')
    return html`
      <div class="tap amount" title=${item.hint}>
        <label for=${`error-${item.item}`}>${key}<span>${item.name}</span></label>
        <span class="row"><input id=${`error-${item.item}`} type="number" name=${amountName(item)} min="0" max="1000000" step="any"
          defaultValue=${value} onChange=${onTyped} /> ${item.unit}</span>
      </div>`;
  const isYes = item.kind === 'yes_no';
  return html`
    <button class="button tap" type="button" title=${item.hint} aria-pressed=${isYes ? marks.length > 0 : undefined} onClick=${onPress}>
      ${key}<span>${item.name}</span><strong>${isYes ? words.yesNo[Number(marks.length > 0)] : number(marks.length)}</strong>
    </button>`;
}

/** The marks with links to their moments, each of them undone by a button. @param {Props} props */
function Marks({ marks, items, goTo, onUndo }) {
  const named = mark => items.find(item => item.item === mark.item)?.name ?? mark.item;
  const sorted = [...marks].sort((a, b) => (a.at_s ?? Infinity) - (b.at_s ?? Infinity));
  return html`<ul class="error-marks" aria-label=${words.marks}>${sorted.map(mark => html`
    <li key=${mark.key}><${MarkTime} mark=${mark} goTo=${goTo} /><span>${named(mark)}</span>
      <button class="button bare" type="button" aria-label=${words.undoThis(named(mark), mark.at_s === null ? '' : clock(mark.at_s))}
        onClick=${() => onUndo(mark)}>${t.form.remove}</button></li>`)}</ul>`;
}

/** The moment of a mark: a button that goes there. @param {Props} props */
export const MarkTime = ({ mark, goTo }) => {
  if (mark.at_s === null) return html`<span class="small muted">${words.noMoment}</span>`;
  if (!goTo) return html`<span class="small">${clock(mark.at_s)}</span>`;
  return html`<button class="button jump" type="button" aria-label=${t.session.evidence.jump(clock(mark.at_s))}
    onClick=${() => goTo(mark.at_s)}>${clock(mark.at_s)}</button>`;
};
