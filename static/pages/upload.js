// Upload: choose for whom, then drop files or pick them. The sending itself lives in parts/uploads.js and outlasts this page.
import { html, useEffect, useRef, useState } from '../parts/preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { may } from '../roles.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { Field } from '../parts/form.js';
import { icons } from '../parts/icons.js';
import { Empty, Loading, Notice, PageHead, ProblemNotice } from '../parts/notice.js';
import { traineeId } from '../parts/shell.js';
import { Sending } from '../parts/sending.js';
import { addFiles, onUploads, uploads } from '../parts/uploads.js';

const words = t.upload;
const KINDS = ['trainee', 'task', 'box'];
const LABELS = { trainee: words.who, task: words.what, box: words.where };
const ACCEPT = 'video/*,.mp4,.mov,.mkv,.webm,.avi,.ts,.m4v';

export default function UploadPage({ person, route }) {
  const own = may(person, 'upload') ? null : traineeId(person);
  const {
    data: lists,
    problem,
    reload,
  } = useData(async () => {
    const trainees = own
      ? api.trainees.get(own).then(
          one => [one],
          () => [{ id: own, name: person.trainee?.name ?? person.name }],
        )
      : api.trainees.all();
    const [trainee, task, box] = await Promise.all([trainees, api.tasks.all(), api.boxes.all()]);
    return { trainee, task, box };
  }, []);
  const [items, setItems] = useState(uploads);
  useEffect(() => onUploads(() => setItems(uploads())), []);

  if (!may(person, 'upload') && !own)
    return html`<${PageHead} title=${words.title} /><${Notice} tone="warn" title=${words.noTrainee} />`;
  const chosen = Object.fromEntries(KINDS.map(kind => [kind, choice(lists?.[kind], route.query.get(kind))]));
  const target = KINDS.every(kind => chosen[kind])
    ? Object.fromEntries(KINDS.map(kind => [kind, chosen[kind].id]))
    : null;
  const set = kind => event =>
    replace(['upload'], {
      ...Object.fromEntries(KINDS.map(name => [name, chosen[name]?.id])),
      [kind]: event.target.value,
    });
  return html`
    <${PageHead} title=${words.title} lead=${words.lead} />
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    ${!lists && !problem && html`<${Loading} />`}
    ${lists && html`<${Target} lists=${lists} chosen=${chosen} onSet=${set} target=${target} />`}
    <section class="card list">
      <header><h2>${words.list}</h2></header>
      ${items.length ? html`<${Sending} items=${items} />`
        : html`<${Empty} title=${words.none} body=${words.noneBody} />`}
    </section>`;
}

/** By id or code; where there is only one, it is chosen already. */
const choice = (list = [], key) =>
  list.find(item => item.id === key || item.code === key) ?? (list.length === 1 ? list[0] : null);

function Target({ lists, chosen, onSet, target }) {
  const when = useRef(null);
  const [heldUp, setHeldUp] = useState(false);
  const missing = KINDS.filter(kind => lists[kind].length === 0);
  const take = files => {
    if (!target) return setHeldUp(true);
    setHeldUp(false);
    const recorded = when.current.value && new Date(when.current.value).toISOString();
    addFiles(
      [...files],
      { ...target, ...(recorded ? { recorded_at: recorded } : {}) },
      words.forWhom(...KINDS.map(kind => chosen[kind].name)),
    );
    return undefined;
  };
  return html`
    <section class="card">
      <div class="body stack">
        ${missing.map(kind => html`<${Notice} key=${kind} tone="warn" title=${words.missing[kind]}>
          <a href=${href([{ trainee: 'trainees', task: 'tasks', box: 'boxes' }[kind]])}>${words.make}</a><//>`)}
        <div class="fields">
          ${KINDS.map(kind => html`<${Field} key=${kind} type="select" label=${LABELS[kind]} value=${chosen[kind]?.id}
            options=${[['', words.choose], ...lists[kind].map(item => [item.id, item.name])]}
            onInput=${onSet(kind)} />`)}
          <${Field} type="datetime-local" label=${words.when} hint=${words.whenHint} inputRef=${when} />
        </div>
        <${Drop} onFiles=${take} />
        ${heldUp && !target && html`<p class="notice warn" role="alert"><${icons.warning} /><strong>
          ${words.need}</strong></p>`}
      </div>
    </section>`;
}

function Drop({ onFiles }) {
  const [over, setOver] = useState(false);
  const input = useRef(null);
  const stop = (event, state) => {
    event.preventDefault();
    setOver(state);
  };
  const drop = event => {
    stop(event, false);
    onFiles(event.dataTransfer.files);
  };
  const picked = () => {
    onFiles(input.current.files);
    input.current.value = ''; // The same file may be chosen again.
  };
  return html`
    <div class=${`drop ${over ? 'over'
      : ''}`} onDragEnter=${event => stop(event, true)} onDragOver=${event => stop(event, true)}
      onDragLeave=${event => stop(event, false)} onDrop=${drop}>
      <${icons.upload} size=${36} />
      <div><strong>${words.drop}</strong><p class="muted">${words.or}</p></div>
      <label class="button main"><input ref=${input} type="file" multiple accept=${ACCEPT} onChange=${picked} />
        ${words.pick}</label>
    </div>`;
}
