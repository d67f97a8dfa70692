// How long the videos of one trainee are kept, and when the oldest is deleted.
import { html, useState } from '../../preact.js';
import { api, Problem } from '../../api.js';
import { useData } from '../../data.js';
import { bytes, date } from '../../format.js';
import { t } from '../../texts.js';
import { Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Loading, ProblemNotice } from '../page/notice.js';

const words = t.retention;

/** The card on the own account and on the page of a trainee. @param {Props} props */
export function RetentionCard({ trainee, name, mayEdit }) {
  const [editing, setEditing] = useState(false);
  const { data, problem, reload } = useData(signal => api.trainees.retention(trainee, signal), [trainee]);
  return html`
    <section class="card unprinted">
      <header><h2>${words.title}</h2></header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${!data && !problem && html`<${Loading} />`}
        ${data && html`
          <dl class="facts">
            <dt>${words.kept}</dt><dd>${words.months(data.months)} ${source(data)}</dd>
            ${data.reason && html`<dt>${words.reason}</dt><dd class="said">${data.reason}</dd>`}
            <dt>${words.oldest}</dt><dd>${data.oldest_at ? words.oldestOf(date(data.oldest_at), data.videos) : words.noVideo}</dd>
            ${data.oldest_at && html`<dt>${words.deleted}</dt><dd>${data.oldest_deleted_at ? date(data.oldest_deleted_at) : words.never}</dd>`}
          </dl>
          <p class="small muted">${words.rest}</p>
          ${mayEdit && html`<p><button class="button" type="button" onClick=${() => setEditing(true)}>${words.change}</button></p>`}`}
      </div>
      ${editing && html`<${RetentionDialog} trainee=${trainee} name=${name} now=${data} onDone=${() => (setEditing(false), reload())}
        onClose=${() => setEditing(false)} />`}
    </section>`;
}

/** Where the months come from. @param {Schemas['RetentionResponse']} retention */
const source = ({ own_months: own, months }) => `(${own === null || own === undefined || own !== months ? words.ofCentre : words.ofTrainee})`;

/** Asks for the months; then, if videos would be deleted at once, for the name. @param {Props} props */
function RetentionDialog({ trainee, name, now, onDone, onClose }) {
  const [asked, setAsked] = useState(null); // { months, reason, videos, bytes }
  const save = async (wanted, confirmed) => {
    await api.trainees.setRetention(trainee, { months: wanted.months, reason: wanted.reason, confirmed_videos: confirmed });
    onDone();
  };
  const ask = async ({ months = null, reason }) => {
    const preview = await api.trainees.previewRetention(trainee, { months });
    if (preview.needs_reason && !reason) throw new Problem({ title: words.needsReason(now.centre_months), status: 0 });
    if (preview.videos === 0) return save({ months, reason }, 0);
    return setAsked({ months, reason, ...preview });
  };
  const confirm = values => {
    if (values.name?.trim() !== name) throw new Problem({ title: t.erasures.otherName(name), status: 0 });
    return save(asked, asked.videos);
  };
  const fields = [
    { name: 'months', label: words.monthsLabel, hint: words.monthsHint(words.months(now.centre_months)), type: 'number', min: 0, max: 1200, step: 1, value: now.own_months },
    { name: 'reason', label: words.reasonLabel, hint: words.reasonHint, type: 'textarea', maxlength: 1800, wide: true, value: now.reason },
  ];
  if (asked)
    return html`
      <${Dialog} title=${words.change} onClose=${onClose}>
        <p><strong>${words.deletes(asked.videos, bytes(asked.bytes))}</strong> ${words.rest}</p>
        <${Form} key="confirm" fields=${[{ name: 'name', label: t.erasures.typeName(name), required: true, autocomplete: 'off' }]}
          onSave=${async values => confirm(values)} onCancel=${() => setAsked(null)} cancel=${words.back} submit=${words.deleteVideos} danger />
      <//>`;
  return html`
    <${Dialog} title=${words.change} onClose=${onClose}>
      <${Form} key="ask" fields=${fields} onSave=${ask} onCancel=${onClose} />
    <//>`;
}
