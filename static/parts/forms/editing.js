// Lists of things that people add, edit and delete: trainees, tasks, boxes, people. One flow for all of them.
import { html, useState } from '../../preact.js';
import { t } from '../../texts.js';
import { Confirm, Dialog } from './dialog.js';
import { Form } from './form.js';
import { icons } from '../page/icons.js';

/**
 * `const edit = useEditing({ addTitle, editTitle, removeTitle, fields, save, remove, onChange })` gives `edit.add()`,
 * `edit.change(item)`, `edit.remove(item)` and `edit.dialogs` to put on the page. `fields(item)` returns the form's
 * fields; `item` is null for a new one. A list that only changes its items needs neither `addTitle` nor `remove`.
 *
 * @param {{ addTitle?: string, editTitle: string, removeTitle?: (name: string) => string, removeBody?: string,
 *   fields: (item: any) => object[], save: (item: any, values: any) => Promise<unknown>,
 *   remove?: (item: any) => Promise<unknown>, onChange: () => unknown }} options
 */
export function useEditing({
  addTitle,
  editTitle,
  removeTitle,
  removeBody = t.people.removeBody,
  fields,
  save,
  remove,
  onChange,
}) {
  const [open, setOpen] = useState(null);
  const close = () => setOpen(null);
  const finish = () => (close(), onChange());
  const item = open?.item ?? null;
  const dialogs =
    open &&
    (open.removing
      ? html`<${Confirm} title=${removeTitle?.(item.name)} body=${removeBody} yes=${t.form.remove}
        onYes=${() => remove?.(item).then(onChange)} onClose=${close} />` : html`
      <${Dialog} title=${item ? `${editTitle}: ${item.name}` : addTitle} onClose=${close}>
        <${Form} fields=${fields(item)} onSave=${values => save(item, values).then(finish)} onCancel=${close} />
      <//>`);
  return {
    add: () => setOpen({}),
    change: chosen => setOpen({ item: chosen }),
    remove: chosen => setOpen({ item: chosen, removing: true }),
    dialogs,
  };
}

export const AddButton = ({ label, onClick }) =>
  html`<button class="button main" type="button" onClick=${onClick}><${icons.add} />${label}</button>`;

/** The buttons at the end of a row; they name the item for people who hear them outside the row. */
export const RowButtons = ({ item, onEdit, onRemove }) => html`
  <div class="row ends">
    ${onEdit && html`<button class="button" type="button" aria-label=${`${t.tasks.edit}: ${item.name}`}
      onClick=${() => onEdit(item)}>${t.tasks.edit}</button>`}
    ${onRemove && html`<button class="button bare" type="button" aria-label=${`${t.form.remove}: ${item.name}`}
      onClick=${() => onRemove(item)}>${t.form.remove}</button>`}
  </div>`;

/** Lists are compared without their order. */
const isSame = (one, other) =>
  Array.isArray(one) && Array.isArray(other)
    ? one.length === other.length && one.every(value => other.includes(value))
    : one === other;

/**
 * Creating sends all values; changing sends only those that differ, so that two people editing do not undo each other.
 */
export async function saveChanges(resource, item, values) {
  if (!item) return resource.create(values);
  const differs = Object.entries(values).filter(
    ([key, value]) =>
      value !== undefined && !isSame(value, item[key] ?? null) && !(value === null && item[key] === undefined),
  );
  return differs.length ? resource.change(item.id, Object.fromEntries(differs)) : item;
}
