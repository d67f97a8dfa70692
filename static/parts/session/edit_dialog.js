// Asks for the reason of an edit, says what it will do, and submits it.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { number } from '../../format.js';
import { t } from '../../texts.js';
import { Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { spanName } from './span_bar.js';

const words = t.session.edits;

/** The true frame rate or the true length: one of them. */
const timeFields = [
  { name: 'known', label: words.whichTime, type: 'select', value: 'rate', options: Object.entries(words.times) },
  {
    name: 'rate',
    label: words.trueRate,
    type: 'number',
    step: 'any',
    min: 1,
    max: 1000,
    required: true,
    when: chosen => chosen.known === 'rate',
  },
  {
    name: 'length',
    label: words.trueLength,
    type: 'number',
    step: 'any',
    min: 0.1,
    max: 86400,
    required: true,
    when: chosen => chosen.known === 'length',
  },
];

/** What the person who answers for the box has seen there; it becomes the reason. */
const changedField = { name: 'changed', label: words.changed, type: 'select', value: 'nothing', options: Object.entries(words.changes), wide: true };

/** @param {Props} props */
export function EditDialog({ kind, session, span, tools, revision, onDone, onClose }) {
  const isAnswer = kind === 'this_box' || kind === 'other_box';
  const pairs = tools.flatMap((one, index) => tools.slice(index + 1).map(other => [one, other]));
  const fields = [
    ...(kind === 'swap' && pairs.length > 1
      ? [{ name: 'pair', label: words.which, type: 'select', value: '0', options: pairs.map((pair, at) => [String(at), pair.join(' ↔ ')]) }]
      : []),
    ...(kind === 'retime' ? timeFields : []),
    ...(kind === 'this_box' ? [changedField] : []),
    { name: 'why', label: isAnswer ? words.remark : words.why, hint: words.whyHint[kind], type: 'textarea', required: !isAnswer, optional: isAnswer,
      maxlength: 1800, wide: true, autofocus: kind !== 'retime' && !isAnswer },
  ];
  const save = async ({ why: given, pair = '0', rate, length, changed = 'nothing' }) => {
    const said = { this_box: words.changes[changed], other_box: words.saysOther }[kind];
    const why = said ? [said, given].filter(Boolean).join(' ') : given;
    const more = {
      trim: () => ({ from_s: span[0], to_s: span[1], revision }),
      swap: () => ({ from_s: span[0], to_s: span[1], revision, tools: pairs[Number(pair)] }),
      retime: () => ({ true_frame_rate_hz: rate, true_duration_s: length, revision }),
      set_aside: () => ({}),
      this_box: () => ({ revision }),
      other_box: () => ({ revision }),
    };
    await api.sessions.edit(session.id, { kind, why, ...more[kind]() });
    onDone();
  };
  const clock = session.video?.clock;
  return html`
    <${Dialog} title=${words.asks[kind]} onClose=${onClose}>
      <p>${words.does[kind](span ? spanName(span) : '', pairs.length === 1 ? pairs[0] : null)}</p>
      ${kind === 'this_box' && html`<p class="small muted">${words.ifMoved}</p>`}
      ${kind === 'retime' && clock && html`<p>${
        words.fileSays(number(clock.stamped_frame_rate_hz), number(clock.stamped_duration_s))}</p>`}
      <${Form} fields=${fields} submit=${words.kinds[kind]} onSave=${save} onCancel=${onClose} />
    <//>`;
}
