// Cutting a recording with two attempts into two sessions, and what each of them says about the other.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { clock, dateTime } from '../../format.js';
import { may } from '../../roles.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Notice, ProblemNotice } from '../page/notice.js';

const words = t.session.cuts;
/** A shorter part has no attempt in it, seconds: the video is still at its beginning, or at its end. */
const MIN_PART_S = 1;

/** The button cuts where the video stands. `onCut()` runs after the cut. @param {Props} props */
export function CutButton({ session, playback, onCut }) {
  const [at, setAt] = useState(null);
  const why = { name: 'why', label: words.why, hint: words.whyHint, type: 'textarea', required: true, maxlength: 1800, wide: true };
  const cut = async values => {
    await api.sessions.cut(session.id, { at_s: at, why: values.why });
    setAt(null);
    onCut();
  };
  return html`
    <button class="button" type="button" onClick=${() => setAt(playback.time)}>${words.cut}</button>
    ${at !== null && html`
      <${Dialog} title=${words.title} onClose=${() => setAt(null)}>
        ${at < MIN_PART_S || at > (session.video?.duration_s ?? Infinity) - MIN_PART_S ? html`<p>${words.whereFirst}</p>`
          : html`<p>${words.does(clock(at, 2))}</p>
            <${Form} fields=${[why]} submit=${words.cutAt(clock(at, 2))} onSave=${cut} onCancel=${() => setAt(null)} />`}
      <//>`}`;
}

/** Says that a session is a part of a recording, and joins the parts. @param {Props} props */
export function Cuts({ session, person, onChange }) {
  const [problem, setProblem] = useState(null);
  const { data, reload } = useData(signal => api.sessions.cuts(session.id, signal), [session.id, session.status]);
  const cuts = data?.items.filter(cut => !cut.joined_at) ?? [];
  // The second part is gone once the parts are joined.
  const afterJoin = cut => (cut.first === session.id && reload(), onChange(cut));
  const join = cut => api.sessions.join(session.id, cut.id).then(() => afterJoin(cut), error => setProblem(asProblem(error)));
  return html`
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
    ${cuts.map(cut => {
      const isFirst = cut.first === session.id;
      const other = isFirst ? cut.second : cut.first;
      return html`<${Notice} key=${cut.id} title=${isFirst ? words.isFirst(clock(cut.at_s, 2)) : words.isSecond(clock(cut.at_s, 2))}>
        ${cut.why && html`<span class="said">${cut.why}</span> `}<span class="small muted">${cut.who ?? t.session.edits.gone}, ${dateTime(cut.created_at)}</span>
        ${other && html` <a href=${href(['sessions', other], isFirst ? { t: String(cut.at_s) } : {})}>${isFirst ? words.toSecond : words.toFirst}</a>`}
        ${other && may(person, 'edit_sessions') && !session.exam && html` <button class="button" type="button" onClick=${() => join(cut)}>${words.join}</button>`}<//>`;
    })}`;
}
