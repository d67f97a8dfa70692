// Buttons under a table: save it for a spreadsheet, or print the page.
import { html } from '../../preact.js';
import { csvText } from '../../csv.js';
import { t } from '../../texts.js';

/**
 * `rows()` returns the table, its heading first. `name`: of the file, without its ending. Without `isPrinted` only
 * saving is offered.
 *
 * @param {{ name: string, rows: () => (string | number | null | undefined)[][], isPrinted?: boolean }} props
 */
export function SaveTable({ name, rows, isPrinted = true }) {
  const save = () => {
    const address = URL.createObjectURL(new Blob([csvText(rows())], { type: 'text/csv;charset=utf-8' }));
    const link = Object.assign(document.createElement('a'), { href: address, download: `${fileName(name)}.csv` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
  };
  return html`
    <div class="body row save-table">
      <button class="button" type="button" onClick=${save}>${t.saveTable.save}</button>
      ${isPrinted && html`<button class="button" type="button" onClick=${() => window.print()}>${t.saveTable.print}</button>`}
    </div>`;
}

/** A name without characters that a file name must not have. */
const fileName = name => name.replace(/[\\/:*?"<>|\s]+/g, '-').replace(/^-+|-+$/g, '');
