// The places of a session's values among the people of a cohort, feature by feature, as the service computes them: with
// an interval, or the reason why there is none. The service places the newest counting session; for any other session,
// the page only says so.
import { html, useEffect, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { reasonText } from '../../translate.js';
import { handOrTool } from '../tasks/hand_choice.js';
import { featuresIn, firstSpace } from './compared_space.js';
import { featureKey } from './evidence.js';

const words = t.session.places;
const NO_COHORT = '-';

/**
 * Returns `{ cohorts, code, choose, answer, askAll }`. `answer` holds the cohort and its `places` by `featureKey`, or
 * the session that is placed instead. At first it covers the features that the standard limits; `askAll()` adds every
 * other feature, with one request each.
 */
export function useCohortPlaces(session) {
  const cohorts = useData(() => api.cohorts.all(), []).data ?? [];
  const [chosen, choose] = useState(null);
  const [answered, setAnswered] = useState(null);
  const [isAll, setAll] = useState(false);
  const code = chosen ?? cohorts[0]?.code ?? NO_COHORT;
  const question = [session.id, session.result, code, isAll].join(' ');
  useEffect(() => {
    if (code === NO_COHORT) return undefined;
    const controller = new AbortController();
    const store = answer => setAnswered({ question, answer });
    loadPlaces(session, code, isAll, controller.signal).then(store, error => error.name !== 'AbortError' && store({ problem: asProblem(error) }));
    return () => controller.abort();
  }, [question]);
  // The answer to an earlier question is never shown, not even until the next one is requested.
  const answer = answered?.question === question ? answered.answer : null;
  return { cohorts, code, choose, answer, askAll: isAll ? null : () => setAll(true) };
}

async function loadPlaces(session, cohort, isAll, signal) {
  const { id, trainee, task, features } = session;
  const measured = featuresIn(features, firstSpace(session)).filter(one => one.value !== null);
  /** @type {Map<string | undefined, Schemas['FeatureResponse']['space'] | undefined>} */
  const spaces = new Map(isAll ? measured.map(one => [one.name, one.space]) : [[undefined, undefined]]);
  /** @type {{ cohort?: Props['progress']['cohort'], newest: object | null, places: Map<string, any> }} */
  const result = { cohort: null, newest: null, places: new Map() };
  for (const [feature, space] of spaces) {
    const progress = await api.trainees.progress(trainee.id, { task: task.id, feature, space, cohort }, signal);
    const newest = progress.sessions.filter(one => !one.set_aside).pop();
    if (newest?.id !== id) return { ...result, newest, general: words.uncounted };
    result.cohort = progress.cohort;
    // A session whose value is only a lower bound has no place; the service then places an earlier one.
    const ofNewest = progress.features.filter(one => !one.place || one.place.session === newest?.number);
    for (const one of ofNewest) result.places.set(featureKey(one.feature, handOrTool(one), one.space), one);
  }
  return { ...result, general: generalReason([...result.places.values()]) };
}

/** Why nothing is placed, if the reason is the same for all: it is shown once, not under every value. */
function generalReason(features) {
  const reasons = new Set(features.map(one => one.no_place && whyNot(one.no_place)));
  return reasons.size === 1 ? [...reasons][0] : null;
}

/** Chooses the cohort, and shows what applies to all places. */
export function CohortChooser({ places: { cohorts, code, choose, answer, askAll } }) {
  if (!cohorts.length) return null;
  return html`
    <div class="row chooser">
      <label class="row small">${words.among}
        <select class="select" value=${code} onChange=${event => choose(event.target.value)}>
          ${cohorts.map(one => html`<option key=${one.code} value=${one.code} selected=${one.code === code}>${one.name}</option>`)}
          <option value=${NO_COHORT} selected=${code === NO_COHORT}>${words.nobody}</option>
        </select></label>
      ${answer?.cohort && askAll && html`<button class="button" type="button" onClick=${askAll}>${words.all}</button>`}
      <span class="small muted" role="status">${code !== NO_COHORT && statusText(answer)}</span>
    </div>`;
}

function statusText(answer) {
  if (!answer) return t.loading;
  if (answer.problem) return words.failed;
  if (answer.newest) return html`${words.older} <a href=${href(['sessions', answer.newest.id])}>${words.newest}</a>`;
  return answer.general ?? (answer.cohort ? null : words.none);
}

const whyNot = why => (why.missing ? t.trainee.notEnough(why.missing, reasonText(why)) : t.trainee.withheld(reasonText(why)));

/** The place of one value, shown under it. @param {Props} props */
export function CohortPlace({ feature, answer }) {
  // The limit of a standard may be for the dominant hand, other features are compared by the left and the right hand.
  const holders = [handOrTool({ in_hand: feature.target?.in_hand, tool: feature.tool }), handOrTool(feature), feature.tool ?? ''];
  const found = holders.map(holder => answer?.places?.get(featureKey(feature.name, holder, feature.space)));
  const featurePlace = found.find(Boolean);
  if (!featurePlace) return null;
  if (featurePlace.no_place && answer.general) return null;
  if (featurePlace.no_place) return html`<small class="place" title=${whyNot(featurePlace.no_place)}>${featurePlace.no_place.missing ? words.tooFew : words.none}</small>`;
  if (!featurePlace.place) return null;
  const { better_than: better, percentile, people, error_known: isKnown } = featurePlace.place;
  const { value, low, high } = better ?? percentile;
  const rounded = /** @type {[number, number, number]} */ ([value, low, high].map(Math.round));
  const whole = `${t.trainee[better ? 'better' : 'above'](...rounded, people, answer.cohort.name)}${isKnown ? '' : ` ${t.trainee.ownErrorUnknown}`}`;
  return html`<small class="place" title=${whole}>${words[better ? 'better' : 'above'](...rounded)}</small>`;
}
