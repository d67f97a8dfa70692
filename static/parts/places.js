// Where a session's values stand among the people of a cohort, feature by feature, as the service tells it: with an interval, or why not.
// It places the newest session that counts, so of any other one only that is said.
import { html, useEffect, useState } from './preact.js';
import { api } from '../api.js';
import { asProblem, useData } from '../data.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { keyOf } from './seconds.js';

const words = t.session.places;
const NOBODY = '-';

/**
 * `{ cohorts, code, choose, told, askAll }`; `told` holds the cohort and its `places` by `keyOf`, or the session that is placed instead.
 * At first of what the task asks for; of every feature when somebody asks, since that is a question each.
 */
export function usePlaces(session) {
  const cohorts = useData(() => api.cohorts.all(), []).data ?? [];
  const [chosen, choose] = useState(null);
  const [answer, setAnswer] = useState(null);
  const [isAll, setAll] = useState(false);
  const code = chosen ?? cohorts[0]?.code ?? NOBODY;
  const question = [session.id, session.result, code, isAll].join(' ');
  useEffect(() => {
    if (code === NOBODY) return undefined;
    const ending = new AbortController();
    const keep = told => setAnswer({ question, told });
    ask(session, code, isAll, ending.signal).then(keep, error => error.name !== 'AbortError' && keep({ problem: asProblem(error) }));
    return () => ending.abort();
  }, [question]);
  // An answer to an earlier question is never shown, not even until the next one has been asked.
  const told = answer?.question === question ? answer.told : null;
  return { cohorts, code, choose, told, askAll: isAll ? null : () => setAll(true) };
}

async function ask({ id, trainee, task, features }, cohort, isAll, signal) {
  const names = new Set(isAll ? features.filter(one => one.space === '3d' && one.value !== null).map(one => one.name) : [undefined]);
  const told = { cohort: null, newest: null, places: new Map() };
  for (const feature of names) {
    const answer = await api.trainees.progress(trainee.id, { task: task.id, feature, space: feature && '3d', cohort }, signal);
    const newest = answer.sessions.filter(one => !one.set_aside).pop();
    if (newest?.id !== id) return { ...told, newest, general: words.uncounted };
    told.cohort = answer.cohort;
    for (const one of answer.features) told.places.set(keyOf(one.feature, one.tool, one.space), one);
  }
  return { ...told, general: generalReason([...told.places.values()]) };
}

/** Why nothing is placed, where it is the same for all: that is said once, not under every value. */
function generalReason(features) {
  const reasons = new Set(features.map(one => one.no_place && whyNot(one.no_place)));
  return reasons.size === 1 ? [...reasons][0] : null;
}

/** Among whom, and what is to be said of all places at once. */
export function PlaceChooser({ places: { cohorts, code, choose, told, askAll } }) {
  if (!cohorts.length) return null;
  return html`
    <div class="row chooser">
      <label class="row small">${words.among}
        <select class="select" value=${code} onChange=${event => choose(event.target.value)}>
          ${cohorts.map(one => html`<option key=${one.code} value=${one.code} selected=${one.code === code}>${one.name}</option>`)}
          <option value=${NOBODY} selected=${code === NOBODY}>${words.nobody}</option>
        </select></label>
      ${told?.cohort && askAll && html`<button class="button" type="button" onClick=${askAll}>${words.all}</button>`}
      <span class="small muted" role="status">${code !== NOBODY && standing(told)}</span>
    </div>`;
}

function standing(told) {
  if (!told) return t.loading;
  if (told.problem) return words.failed;
  if (told.newest) return html`${words.older} <a href=${href(['sessions', told.newest.id])}>${words.newest}</a>`;
  return told.general ?? (told.cohort ? null : words.none);
}

const whyNot = why => (why.missing ? t.trainee.notEnough(why.missing, why.detail) : t.trainee.withheld(why.detail));

/** The place of one value, under it. */
export function PlaceOf({ feature, told }) {
  const of = told?.places?.get(keyOf(feature.name, feature.tool, feature.space));
  if (!of) return null;
  if (of.no_place && told.general) return null;
  if (of.no_place) return html`<small class="place" title=${whyNot(of.no_place)}>${of.no_place.missing ? words.tooFew : words.none}</small>`;
  if (!of.place) return null;
  const { better_than: better, percentile, people, error_known: isKnown } = of.place;
  const { value, low, high } = better ?? percentile;
  const rounded = [value, low, high].map(Math.round);
  const whole = `${t.trainee[better ? 'better' : 'above'](...rounded, people, told.cohort.name)}${isKnown ? '' : ` ${t.trainee.ownErrorUnknown}`}`;
  return html`<small class="place" title=${whole}>${words[better ? 'better' : 'above'](...rounded)}</small>`;
}
