// For whom, of what and where a recording is: chosen on the page, kept in its address, so that a link can choose.
import { html } from './preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { may } from '../roles.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { Field } from './form.js';
import { icons } from './icons.js';
import { Notice } from './notice.js';
import { traineeId } from './shell.js';

const words = t.target;
const KINDS = ['trainee', 'task', 'box'];
const PAGES = { trainee: 'trainees', task: 'tasks', box: 'boxes' };

/** May this person send recordings of anybody? Whoever is no trainee and may not send others' has nothing to send. */
export const maySend = person => may(person, 'upload') || traineeId(person) !== null;

/**
 * `lists` by kind once they are loaded, what is `chosen` of each, `ids` and `names` once all three are, and `set(kind)`
 * for a select's `onInput`. A trainee sends their own recordings only.
 */
export function useTarget({ person, route }) {
  const own = may(person, 'upload') ? null : traineeId(person);
  const { data: lists, problem, reload } = useData(async () => {
    const trainees = own
      ? api.trainees.get(own).then(
          one => [one],
          () => [{ id: own, name: person.trainee?.name ?? person.name }],
        )
      : api.trainees.all();
    const [trainee, task, box] = await Promise.all([trainees, api.tasks.all(), api.boxes.all()]);
    return { trainee, task, box };
  }, []);
  const chosen = Object.fromEntries(KINDS.map(kind => [kind, choice(lists?.[kind], route.query.get(kind))]));
  const ofEach = what => Object.fromEntries(KINDS.map(kind => [kind, chosen[kind]?.[what]]));
  const isWhole = KINDS.every(kind => chosen[kind]);
  const set = kind => event => replace(route.path, { ...ofEach('id'), [kind]: event.target.value });
  return {
    ...{ lists, problem, reload, chosen, set },
    ids: isWhole ? ofEach('id') : null,
    names: isWhole ? words.forWhom(...KINDS.map(kind => chosen[kind].name)) : null,
  };
}

/** By id or code; where there is only one, it is chosen already. */
const choice = (list = [], key) =>
  list.find(item => item.id === key || item.code === key) ?? (list.length === 1 ? list[0] : null);

/** The three choosers; what does not exist yet is said above them. */
export const TargetFields = ({ target: { lists, chosen, set } }) => html`
  ${KINDS.filter(kind => lists[kind].length === 0).map(kind => html`
    <div key=${kind} class="wide"><${Notice} tone="warn" title=${words.missing[kind]}>
      <a href=${href([PAGES[kind]])}>${words.make}</a><//></div>`)}
  ${KINDS.map(kind => html`<${Field} key=${kind} type="select" label=${words[kind]} value=${chosen[kind]?.id}
    options=${[['', words.choose], ...lists[kind].map(item => [item.id, item.name])]} onInput=${set(kind)} />`)}`;

/** Said where somebody goes on without having chosen. */
export const Need = () => html`
  <p class="notice warn" role="alert"><${icons.warning} /><strong>${words.need}</strong></p>`;
