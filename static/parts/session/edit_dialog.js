// Asks for the reason of an edit, says what it will do, and submits it.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { t } from '../../texts.js';
import { Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { spanName } from './span_bar.js';

const words = t.session.edits;

/** @param {Props} props */
export function EditDialog({ kind, session, span, tools, revision, onDone, onClose }) {
  const pairs = tools.flatMap((one, index) => tools.slice(index + 1).map(other => [one, other]));
  const fields = [
    ...(kind === 'swap' && pairs.length > 1
      ? [{ name: 'pair', label: words.which, type: 'select', value: '0', options: pairs.map((pair, at) => [String(at), pair.join(' ↔ ')]) }]
      : []),
    { name: 'why', label: words.why, hint: words.whyHint[kind], type: 'textarea', required: true, maxlength: 2000, wide: true, autofocus: true },
  ];
  const save = async ({ why, pair = '0' }) => {
    const within = kind === 'set_aside' ? {} : { from_s: span[0], to_s: span[1], revision };
    await api.sessions.edit(session.id, { kind, why, ...within, tools: kind === 'swap' ? pairs[Number(pair)] : undefined });
    onDone();
  };
  return html`
    <${Dialog} title=${words.asks[kind]} onClose=${onClose}>
      <p>${words.does[kind](span ? spanName(span) : '', pairs.length === 1 ? pairs[0] : null)}</p>
      <${Form} fields=${fields} submit=${words.kinds[kind]} onSave=${save} onCancel=${onClose} />
    <//>`;
}
