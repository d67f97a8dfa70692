// The evidence of a feature: buttons that show its stretches in the recording and the curves.
import { html } from '../../preact.js';
import { clock, number, percent, unit } from '../../format.js';
import { t } from '../../texts.js';
import { reasonText } from '../../translate.js';

const words = t.session.evidence;

/** Rows of `sessions/{id}/evidence` by the key `feature|tool|space`. */
export const evidenceByFeature = rows => new Map((rows ?? []).map(row => [featureKey(row.feature, row.tool, row.space), row]));
export const featureKey = (feature, tool, space) => [feature, tool ?? '', space].join('|');

/** The times of a stretch as text. */
export const stretchName = ({ from_s: from, to_s: to }) => (to > from ? `${clock(from)}–${clock(to)}` : clock(from));

/** One stretch: a button that goes there. @param {Props} props */
export const StretchButton = ({ stretch, playback, children }) => html`
  <button class="button jump" type="button" aria-label=${words.jump(stretchName(stretch))}
    onClick=${() => playback.showInView(stretch.from_s, stretch.to_s)}>${stretchName(stretch)}${children}</button>`;

/** How much of the feature a stretch contributed, or what caused an absence. */
export function amountText(stretch, row) {
  const amount = `${number(stretch.amount)}${unit(row.unit) ? ` ${unit(row.unit)}` : ''}`;
  const parts = [row.unit === 's' ? null : amount, stretch.share === null ? null : words.share(percent(stretch.share)),
    words.causes[stretch.cause]];
  return parts.filter(Boolean).join(', ');
}

/** All stretches of one row, the largest contribution first; or why there are none. @param {Props} props */
export function Stretches({ row, playback }) {
  if (!row) return null;
  if (!row.stretches.length) return html`<span class="small muted">${row.none && (words.none[row.none.reason] ?? reasonText(row.none))}</span>`;
  return html`
    <span class="small muted">${words.what[row.what] ?? row.what}</span>
    ${row.stretches.map(stretch => html`
      <span key=${stretch.from_s} class="row seconds-of"><${StretchButton} stretch=${stretch} playback=${playback} />
        <small class="muted">${amountText(stretch, row)}</small></span>`)}`;
}
