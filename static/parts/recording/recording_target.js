// The trainee, task and box of a recording: chosen on the page and kept in its address, so that a link can preset them.
import { html, useEffect } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { may } from '../../roles.js';
import { href, replace } from '../../router.js';
import { rememberTarget } from '../../shared_device.js';
import { t } from '../../texts.js';
import { Field } from '../forms/form.js';
import { ConsentNotice, isRefused } from '../people/consent.js';
import { icons } from '../page/icons.js';
import { Notice } from '../page/notice.js';
import { traineeId } from '../page/shell.js';

const words = t.target;
const KINDS = ['trainee', 'task', 'box'];
const PAGES = { trainee: 'trainees', task: 'tasks', box: 'boxes' };

/** Whether this person may send recordings: of any trainee, or, as a trainee, their own. */
export const maySendRecordings = person => may(person, 'upload') || traineeId(person) !== null;

/**
 * Returns `lists` by kind once they are loaded, the `chosen` item of each kind, `ids` and `names` once all three are
 * chosen, `namesOf(ids)` of any three, and `set(kind)` for a select's `onInput`. A trainee sends their own recordings only.
 */
export function useRecordingTarget({ person, route }) {
  const own = may(person, 'upload') ? null : traineeId(person);
  const { data: lists, problem, reload } = useData(async () => {
    const trainees = own
      ? api.trainees.get(own).then(
          one => [one],
          () => [{ id: own, name: person.trainee?.name ?? person.name, consent: null }],
        )
      : api.trainees.all();
    const [trainee, task, boxes] = await Promise.all([trainees, api.tasks.all(), api.boxes.all()]);
    return { trainee, task, box: offeredBoxes(boxes, own !== null), boxes };
  }, []);
  const chosen = Object.fromEntries(KINDS.map(kind => [kind, findItem(lists?.[kind], route.query.get(kind))]));
  const ofEach = what => Object.fromEntries(KINDS.map(kind => [kind, chosen[kind]?.[what]]));
  const { box, task } = ofEach('id');
  useEffect(() => rememberTarget({ box, task }), [box, task]);
  const isTargetComplete = KINDS.every(kind => chosen[kind]);
  const set = kind => event => replace(route.path, { ...ofEach('id'), [kind]: event.target.value });
  const namesOf = ids => {
    const found = KINDS.map(kind => lists?.[kind === 'box' ? 'boxes' : kind].find(item => item.id === ids[kind])?.name);
    return found.every(Boolean) ? words.forWhom(.../** @type {[string, string, string]} */ (found)) : '';
  };
  // The service refuses recordings of a trainee who does not consent.
  const refused = chosen.trainee && isRefused(chosen.trainee.consent) ? chosen.trainee : null;
  const ids = isTargetComplete && !refused ? ofEach('id') : null;
  return { isOwn: own !== null, refused, lists, problem, reload, chosen, set, ids, names: ids && namesOf(ids), namesOf };
}

/** Whether a recording in this box is measured at once: its camera is calibrated, and its tools are marked. */
export const isBoxReady = box => Boolean(box.calibration && box.palette);

/** The boxes that are set up; then, for staff, the others: an imported table needs no camera. */
const offeredBoxes = (boxes, isTrainee) => [...boxes.filter(isBoxReady), ...(isTrainee ? [] : boxes.filter(box => !isBoxReady(box)))];

/** By id or code; a single item is chosen already. */
const findItem = (list = [], key) =>
  list.find(item => item.id === key || item.code === key) ?? (list.length === 1 ? list[0] : null);

/** The three selects; a kind without any items is reported above them. */
export const RecordingTargetFields = ({ target: { lists, chosen, set, refused, isOwn } }) => html`
  ${refused && html`<div class="wide"><${ConsentNotice} trainee=${refused} isOwn=${isOwn} /></div>`}
  ${KINDS.filter(kind => lists[kind].length === 0).map(kind => html`
    <div key=${kind} class="wide">${kind === 'box' && lists.boxes.length ? html`<${Notice} tone="warn" title=${words.noneReady} />` : html`
      <${Notice} tone="warn" title=${words.missing[kind]}><a href=${href([PAGES[kind]])}>${words.make}</a><//>`}</div>`)}
  ${KINDS.map(kind => html`<${Field} key=${kind} type="select" label=${words[kind]} value=${chosen[kind]?.id}
    options=${[['', words.choose], ...lists[kind].map(item => [item.id, optionName(kind, item)])]} onInput=${set(kind)} />`)}`;

const optionName = (kind, item) => (kind === 'box' ? boxName(item) : item.name);

/** The name of a box in a list, with the note that it is not set up. */
export const boxName = box => (isBoxReady(box) ? box.name : words.notSetUp(box.name));

/** Shown when a person continues without having chosen, or with a trainee who does not consent. @param {Props} props */
export const TargetNeeded = ({ refused }) => html`
  <p class="notice warn" role="alert"><${icons.warning} /><strong>${refused ? words.refused(refused.name) : words.need}</strong></p>`;
