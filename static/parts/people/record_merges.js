// Two records of one person, or of one box: merging them after a look at what follows, and separating them again.
import { html, useState } from '../../preact.js';
import { api, Problem } from '../../api.js';
import { useData } from '../../data.js';
import { dateTime } from '../../format.js';
import { t } from '../../texts.js';
import { Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Loading, Notice, ProblemNotice } from '../page/notice.js';

const words = t.merges;

/** The calls and words of a kind of record. */
const KINDS = {
  trainee: { calls: api.trainees, words: words.trainee },
  box: { calls: api.boxes, words: words.box },
};

/** Says that the opened record was merged into the one that is shown. @param {Props} props */
export const MergedNotice = ({ record, opened }) =>
  ![record.id, record.code].includes(opened) && html`<${Notice} title=${words.ledHere(record.name)} />`;

/**
 * The card with the merges of a record. `kind`: `trainee` or `box`. `onChange()` runs after a merge and a separation.
 * @param {Props} props
 */
export function RecordMerges({ kind, record, onChange }) {
  const { calls, words: own } = KINDS[kind];
  const [merging, setMerging] = useState(false);
  const [separating, setSeparating] = useState(null);
  const { data, problem, reload } = useData(signal => calls.merges(record.id, signal), [kind, record.id]);
  const done = () => {
    setMerging(false);
    setSeparating(null);
    reload();
    onChange();
  };
  return html`
    <section class="card record-merges unprinted">
      <header><h2>${own.title}</h2></header>
      <div class="body stack">
        <p class="small muted">${own.body}</p>
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${data && data.items.length > 0 && html`
          <ul class="edit-list">${data.items.map(made => html`
            <li key=${made.id}>
              <div>
                <strong>${words.merged(made.merged.name, made.merged.code)}</strong>
                <p class="said">${made.why}</p>
                <p class="small muted">${made.who ?? t.session.edits.gone}, ${dateTime(made.created_at)}</p>
                ${made.follow.length > 0 && html`<p class="small muted">${made.follow.map(one => words.part(own.parts[one.part] ?? words.parts[one.part], one.rows)).join(' · ')}</p>`}
                ${made.separated_at && html`<p class="small">${words.separated(made.separated_who ?? t.session.edits.gone, dateTime(made.separated_at))}</p>
                  <p class="said">${made.separated_why}</p>`}
              </div>
              ${!made.separated_at && html`<button class="button" type="button" aria-label=${`${words.separate}: ${made.merged.name}`}
                onClick=${() => setSeparating(made)}>${words.separate}</button>`}
            </li>`)}</ul>`}
        <p><button class="button" type="button" onClick=${() => setMerging(true)}>${own.open}</button></p>
      </div>
      ${merging && html`<${MergeDialog} kind=${kind} record=${record} onDone=${done} onClose=${() => setMerging(false)} />`}
      ${separating && html`<${SeparateDialog} kind=${kind} record=${record} made=${separating} onDone=${done}
        onClose=${() => setSeparating(null)} />`}
    </section>`;
}

const why = { name: 'why', label: words.why, type: 'textarea', required: true, maxlength: 1800, wide: true };

/** Asks for the other record, shows what would happen, and asks for the reason. @param {Props} props */
function MergeDialog({ kind, record, onDone, onClose }) {
  const { calls, words: own } = KINDS[kind];
  const { data: all, problem, reload } = useData(() => calls.all(), [kind]);
  const [asked, setAsked] = useState(null); // What the service says about the merge.
  const others = all?.filter(one => one.id !== record.id) ?? [];
  const look = async ({ other }) => {
    if (!other) throw new Problem({ title: words.chooseFirst, status: 0 });
    setAsked(await calls.previewMerge(record.id, { [kind]: other }));
  };
  const merge = async values => {
    const confirmed = kind === 'trainee' && { confirmed_videos: asked.due_videos };
    await calls.merge(record.id, { [kind]: asked.merged.id, why: values.why, ...confirmed });
    onDone();
  };
  const options = [['', words.choose], ...others.map(one => [one.id, `${one.name} (${one.code})`])];
  return html`
    <${Dialog} title=${own.ask(record.name)} onClose=${onClose}>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!all && !problem && html`<${Loading} />`}
      ${all && !asked && html`
        <p>${own.does(record.name)}</p>
        <${Form} key="ask" fields=${[{ name: 'other', label: own.other, type: 'select', options }]} onSave=${look}
          onCancel=${onClose} submit=${words.look} busyWords=${t.loading} />`}
      ${asked && html`
        <${MergeEffect} kind=${kind} kept=${record} effect=${asked} />
        <${Form} key="merge" fields=${[{ ...why, hint: words.whyHint }]} onSave=${merge} onCancel=${() => setAsked(null)}
          cancel=${t.retention.back} submit=${words.merge} />`}
    <//>`;
}

/** What follows, what stays, and which of two different values counts. @param {Props} props */
function MergeEffect({ kind, kept, effect }) {
  const { words: own } = KINDS[kind];
  const { merged, parts } = effect;
  const rules = [
    own.names(kept.name),
    effect.takes_level && words.takesLevel,
    effect.takes_handedness && words.takesHand,
    effect.closed_login && words.closed(effect.closed_login),
    effect.consent && effect.consent !== 'not_needed' && words.consent(t.consent.states[effect.consent]),
    effect.due_videos > 0 && words.dueVideos(effect.due_videos),
  ].filter(Boolean);
  return html`
    <p>${words.effect(merged.name, merged.code, kept.name)}</p>
    ${parts.length === 0 && html`<p>${words.nothing}</p>`}
    ${parts.length > 0 && html`
      <div class="scroll"><table class="table">
        <thead><tr><th scope="col">${words.what}</th><th scope="col" class="right">${words.follow}</th>
          <th scope="col" class="right">${words.stay}</th></tr></thead>
        <tbody>${parts.map(one => html`<tr key=${one.part}><th scope="row">${own.parts[one.part] ?? words.parts[one.part]}</th>
          <td class="right">${one.follow}</td><td class="right">${one.stay}</td></tr>`)}</tbody>
      </table></div>
      ${parts.some(one => one.stay > 0) && html`<p class="small muted">${words.stayBody}</p>`}`}
    <ul>${rules.map(rule => html`<li key=${rule}>${rule}</li>`)}</ul>`;
}

/** @param {Props} props */
function SeparateDialog({ kind, record, made, onDone, onClose }) {
  const { calls } = KINDS[kind];
  const separate = async values => {
    await calls.separate(record.id, made.id, { why: values.why });
    onDone();
  };
  return html`
    <${Dialog} title=${words.separateTitle(made.merged.name)} onClose=${onClose}>
      <p>${words.separateBody(made.merged.name, record.name)}</p>
      <${Form} fields=${[why]} onSave=${separate} onCancel=${onClose} submit=${words.separate} />
    <//>`;
}
