// Reads and writes tables of spreadsheets (RFC 4180): commas, semicolons or tabs, quotes, any line ending.
import { language } from './texts.js';

/** The text of a file: UTF-16 with a byte order mark, else UTF-8, else Windows-1252 as older spreadsheets write it. */
export async function decodeFile(file) {
  const bytes = await file.arrayBuffer();
  const [first, second] = new Uint8Array(bytes);
  if (first === 0xff && second === 0xfe) return new TextDecoder('utf-16le').decode(bytes);
  try {
    return new TextDecoder('utf-8', { fatal: true }).decode(bytes);
  } catch {
    return new TextDecoder('windows-1252').decode(bytes);
  }
}

/** The rows of a table, each a list of texts; empty lines are left out. */
export function parseRows(text) {
  const { plain, separator } = splitSeparatorLine(text.replace(/^\uFEFF/, '').replace(/\r\n?/g, '\n'));
  const rows = [];
  let [row, cell, isQuoted] = [/** @type {string[]} */ ([]), '', false];
  const endCell = () => (row.push(cell.trim()), (cell = ''));
  const endRow = () => {
    endCell();
    if (row.some(Boolean)) rows.push(row);
    row = [];
  };
  for (let i = 0; i < plain.length; i += 1) {
    const c = plain[i];
    if (isQuoted) {
      if (c !== '"') cell += c;
      else if (plain[i + 1] === '"') [cell, i] = [`${cell}"`, i + 1];
      else isQuoted = false;
    } else if (c === '"' && cell.trim() === '') [isQuoted, cell] = [true, ''];
    else if (c === separator) endCell();
    else if (c === '\n') endRow();
    else cell += c;
  }
  endRow();
  return rows;
}

/** The text from its first row on, and its separator, which some spreadsheets declare in a `sep=` line before it. */
function splitSeparatorLine(text) {
  const [whole, declared] = /^\s*sep=(.)\n/i.exec(text) ?? [''];
  const plain = text.slice(whole.length).replace(/^\s*\n/, '');
  return { plain, separator: declared ?? guessSeparator(plain) };
}

/** The separator that occurs most often in the first line, outside quotes. */
function guessSeparator(text) {
  const first = text.split('\n', 1)[0].replace(/"[^"]*"/g, '');
  const count = separator => first.split(separator).length;
  return [',', ';', '\t'].reduce((best, one) => (count(one) > count(best) ? one : best));
}

/** A text that a spreadsheet would run as a formula. */
const FORMULA = /^[=+\-@\t\r]/;

/**
 * A table that the reader's spreadsheet opens in columns: with semicolons and decimal commas in German, and a byte order
 * mark, without which umlauts break. `null` is an empty cell.
 *
 * @param {(string | number | null | undefined)[][]} rows
 */
export function csvText(rows) {
  const [separator, decimal] = language === 'de' ? [';', ','] : [',', '.'];
  const cell = value => {
    if (value === null || value === undefined) return '';
    if (typeof value === 'number') return String(value).replace('.', decimal);
    const text = FORMULA.test(value) ? `'${value}` : value;
    return /[",;\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  return `\uFEFF${rows.map(row => row.map(cell).join(separator)).join('\r\n')}\r\n`;
}

/** Date and time in the reader's time zone, as every spreadsheet reads it: 2026-01-05 17:04. */
export function csvTime(iso) {
  if (!iso) return null;
  const at = new Date(iso);
  const [month, day, hour, minute] = [at.getMonth() + 1, at.getDate(), at.getHours(), at.getMinutes()].map(part => String(part).padStart(2, '0'));
  return `${at.getFullYear()}-${month}-${day} ${hour}:${minute}`;
}
