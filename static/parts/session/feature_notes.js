// The words beside the number of a feature: what it says about the trainee and which side is better, how it is
// measured, why a value says nothing, and why a limit is neither kept nor missed.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { fixed, number, unit } from '../../format.js';
import { serviceLang, t } from '../../texts.js';
import { withError } from '../../with_error.js';

const words = t.session;

/** Whether the error bar leaves nothing of the value. @param {Schemas['FeatureResponse']} feature */
export const isUninformative = feature => feature.informative === false;

/** Why the value says nothing. @param {Schemas['FeatureResponse']} feature */
export const uninformativeText = ({ too_uncertain: why }) => words.saysNothingBecause(words.uninformative[why ?? '']);

/** What a feature says about the trainee, which side is better, and how it is measured. @param {Props} props */
export const Meaning = ({ row: { name, family, better } }) => html`
  ${words.meanings[name] && html`<small class="meaning">${words.meanings[name]} ${sideText(better, family)}</small>`}
  <${Measured} name=${name} />`;

const sideText = (better, family) => words.better[better === 'neither' && family === 'view' ? 'recording' : (better ?? '')] ?? '';

/** The list of features, requested when the first definition is opened. */
let catalogue = null;

/** The definition of a feature, in a fold. */
function Measured({ name }) {
  const [definition, setDefinition] = useState(null);
  const load = async event => {
    if (!event.currentTarget.open || definition) return;
    catalogue ??= api.features();
    const found = await catalogue.then(items => items.find(one => one.name === name), () => (catalogue = null));
    setDefinition(found ?? { description: words.measured.unknown });
  };
  return html`
    <details class="how" onToggle=${load}>
      <summary>${words.measured.title}</summary>
      ${words.measured.plain[name] && html`<small>${words.measured.plain[name]}</small>`}
      <small lang=${serviceLang}>${definition?.description ?? t.loading}</small>
      ${definition?.source && html`<small lang=${serviceLang}>${words.measured.source} ${definition.source}</small>`}
    </details>`;
}

const inUnit = (text, one) => [text, unit(one.unit)].filter(Boolean).join(' ');

/**
 * `8.2 ± 1.1 s against at most 9 s: …`, and which value would be kept; empty for a limit that was judged, and for one
 * that was not judged for another reason.
 *
 * @param {Schemas['FeatureResponse']} one
 */
export function undecidedText(one) {
  const { target, judgement, value, error } = one;
  if (judgement !== 'undecided' || !target || typeof value !== 'number' || !error) return '';
  const limit = t.report.limits[target.better](inUnit(number(target.limit), one));
  const bound = target.better === 'lower' ? target.limit - (error.high - value) : target.limit + (value - error.low);
  const kept = bound > 0 ? words.wouldBeKept(t.report.limits[target.better](inUnit(cautious(bound, error, target.better), one))) : '';
  return words.undecidedMeans(inUnit(withError(value, error).join(' ± '), one), limit, kept);
}

/** What the computer's own rounding may add to a number. */
const ROUNDING = 1e-6;

/** The number with the digits of the error, rounded to the side that surely keeps the limit. */
function cautious(bound, { low, high }, better) {
  const digits = Math.min(3, Math.max(0, 1 - Math.floor(Math.log10((high - low) / 2))));
  const scale = 10 ** digits;
  const steps = better === 'lower' ? Math.floor(bound * scale + ROUNDING) : Math.ceil(bound * scale - ROUNDING);
  return fixed(steps / scale, digits);
}

/**
 * Why values of a row say nothing, and why limits are neither kept nor missed. A note on every tool's value names none.
 */
export function valueNotes(row) {
  const features = [...row.byTool.values()];
  const notes = features.flatMap(one => {
    const texts = [isUninformative(one) ? uninformativeText(one) : '', undecidedText(one)];
    return texts.filter(Boolean).map(text => ({ tool: one.tool, text }));
  });
  const isSame = features.length > 1 && notes.length === features.length && new Set(notes.map(({ text }) => text)).size === 1;
  return isSame ? [capital(notes[0].text)] : notes.map(({ tool, text }) => (tool ? `${tool}: ${text}` : capital(text)));
}

const capital = text => text.charAt(0).toUpperCase() + text.slice(1);
