// The first card of a scored session: whether it met the standard, each value of the standard with its limit and the last
// session's value, and where a missed limit was lost. Without a standard, time and path.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { date, number, unit } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { featureTitle, featureWithTool, handText } from '../../translate.js';
import { pointText, withError } from '../../with_error.js';
import { outcomeOf, StatusPill } from '../page/status.js';
import { featuresIn, firstSpace } from './compared_space.js';
import { isUninformative, undecidedText, uninformativeText } from './feature_notes.js';
import { evidenceByFeature, featureKey, stretchName } from './evidence.js';

const words = t.outcome;
/**
 * What is shown of a task without a standard: the duration of the session, and the path of each tool.
 *
 * @param {Schemas['FeatureResponse']} feature
 */
const isShownWithoutStandard = ({ name, tool = null }) => (name === 'duration' && tool === null) || name === 'path_length';
const SHOWN_OUTCOMES = ['passed', 'missed', 'undecided', 'done'];

/** Not shown while values are withheld or the box is asked about: another notice then says why. @param {Props} props */
export function OutcomeCard({ session }) {
  const outcome = outcomeOf(session);
  const limited = session.features.filter(one => one.target);
  const rows = limited.length ? limited : featuresIn(session.features, firstSpace(session)).filter(isShownWithoutStandard);
  if (!SHOWN_OUTCOMES.includes(outcome) || !rows.length) return null;
  return html`<${Card} session=${session} outcome=${outcome} limited=${limited} rows=${rows} />`;
}

/** @param {Props} props */
function Card({ session, outcome, limited, rows }) {
  const last = useLastTime(session);
  const evidence = useEvidenceOfMissed(session);
  return html`
    <section class="card outcome-card" aria-label=${words.name}>
      <header>
        <div class="row"><h2>${words.titles[session.set_aside || session.voided ? 'aside' : outcome]}</h2>${
          outcome !== 'done' && html`<${StatusPill} state=${outcome} />`}</div>
        ${last.at && html`<span class="small muted">${words.lastWas(date(last.at))}</span>`}
      </header>
      <div class="scroll">
        <table class="table">
          <thead><tr><th scope="col">${t.session.feature}</th><th scope="col" class="number">${words.value}</th>
            ${limited.length > 0 && html`<th scope="col">${words.limit}</th>`}
            <th scope="col" class="number">${words.last}</th></tr></thead>
          <tbody>${rows.map(one => html`
            <tr key=${featureKey(one.name, one.tool, one.space)}>
              <th scope="row">${limited.length ? featureWithTool(one) : [featureTitle(one), handText(one)].filter(Boolean).join(', ')}</th>
              <td class=${`number ${isUninformative(one) ? 'faint' : ''}`}>${valueText(one)}${
                isUninformative(one) && html`<small class="says-nothing">${uninformativeText(one)}</small>`}</td>
              ${limited.length > 0 && html`<td><${Limit} one=${one} /><${Undecided} one=${one} />
                <${Where} session=${session} row=${evidence?.get(featureKey(one.name, one.tool, one.space))} one=${one} /></td>`}
              <td class="number muted">${last.text(one)}</td>
            </tr>`)}</tbody>
        </table>
      </div>
      ${session.unknown_hand ? html`<p class="small muted keys">${words.unknownHand}</p>`
        : !limited.length && !session.set_aside && !session.voided && html`<p class="small muted keys">${last.standard?.valid_from ? words.earlier(date(last.standard.valid_from)) : words.noStandard}</p>`}
    </section>`;
}

const inUnit = (text, one) => [text, unit(one.unit)].filter(Boolean).join(' ');

/** @param {Schemas['FeatureResponse']} one */
function valueText(one) {
  if (one.value === null) return t.session.notEnough;
  if (one.is_lower_bound) return inUnit(t.session.atLeast(number(one.value)), one);
  return inUnit(one.error ? withError(one.value, one.error).join(' ± ') : number(one.value), one);
}

/** @param {Props} props */
const Limit = ({ one: { target, judgement, unit: of } }) => html`
  <span class=${`limit ${judgement}`}>${inUnit(t.report.limits[target.better](number(target.limit)), { unit: of })}: ${
    t.report.judgements[judgement ?? '']}</span>`;

/** Why a limit is neither kept nor missed, and what would keep it. @param {Props} props */
const Undecided = ({ one }) => undecidedText(one) && html`<small class="undecided-why">${undecidedText(one)}</small>`;

/** A link to the stretch that contributed most to a missed value. @param {Props} props */
const Where = ({ session, row, one }) => {
  const stretch = one.judgement === 'fail' && row?.stretches[0];
  return stretch ? html`<a class="small" href=${href(['sessions', session.id], { t: String(stretch.from_s) })}>${
    words.where(stretchName(stretch))}</a>` : null;
};

/** The stretches of the features; read only if a limit was missed. */
function useEvidenceOfMissed(session) {
  const missed = session.features.some(one => one.judgement === 'fail');
  return useData(
    async signal => (missed ? evidenceByFeature((await api.sessions.evidence(session.id, signal).catch(() => null))?.features) : null),
    [session.id, session.result, missed],
  ).current;
}

/** Whether a series of the progress is about the hand or tool of a session's feature. */
const isOfSameHand = (series, one) =>
  one.target?.in_hand ? series.in_hand === one.target.in_hand
    : (series.tool ?? null) === one.tool && (series.in_hand === null || series.in_hand === one.in_hand) && (one.tool !== null) === (series.tool !== null || series.in_hand !== null);

/**
 * The trainee's session of the task before this one that counts: when it was recorded, and its value of a feature; with
 * the task's standard of today.
 */
function useLastTime(session) {
  const { current: data } = useData(
    signal => api.trainees.progress(session.trainee.id, { task: session.task.id }, signal).catch(() => null),
    [session.id, session.result, session.trainee.id, session.task.id],
  );
  const own = data?.sessions.find(step => step.id === session.id)?.number ?? 0;
  const before = data?.sessions.findLast(step => step.number < own && step.set_aside === null);
  const text = one => {
    const series = data?.features.find(of => of.feature === one.name && of.space === one.space && isOfSameHand(of, one));
    const point = before && series?.points.find(of => of.session === before.number);
    const { value = null, low = null, high = null, is_lower_bound = false } = point || {};
    return value === null ? '–' : inUnit(pointText({ value, low, high, is_lower_bound }), one);
  };
  return { at: before?.recorded_at, text, standard: data?.standard };
}
