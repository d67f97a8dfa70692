// The sentences that the service's sources have for problems that say why something is not possible now, read from the
// literals of the calls. `{}` is what the service inserts.
const CALLS = [
  // What a handler says is shown as it is.
  { of: /\bRefusal::(?:Conflict|Gone|TooMany)\s*\.with\(/g, isWhole: true },
  // These get a capital letter and a full stop in src/http/error.rs.
  { of: /\bStoreError::refused\(/g },
  { of: /\bStoreError::LimitReached \{/g },
  { of: /\bIssueError::NotMet\(/g },
  { of: /\bCloseReason::new\((?=\s*CloseCode::(?:Busy|Superseded|Unknown),)/g },
  { of: /#\[error\((?="[^"]*"\)\]\s+TooLong,)/g, only: 'src/certificates/mod.rs' },
  { of: /\bfn video_deleted\(&self\) -> Option<String> \{/g, only: 'src/store/sessions/mod.rs' },
];
const CLOSES = { '(': ')', '{': '}' };

/** The text after an opening bracket, up to the one that closes it. Brackets in literals do not count. */
function inside(text, from) {
  const open = text[from - 1];
  let depth = 1;
  for (const { 0: token, index } of text.slice(from).matchAll(/"(?:[^"\\]|\\.)*"|[(){}]/gs)) {
    if (token === open) depth++;
    if (token === CLOSES[open] && --depth === 0) return text.slice(from, from + index);
  }
  throw new Error(`no end: ${text.slice(from, from + 80)}`);
}

/** The literals that are sentences, as the program has them. */
const sentencesIn = code => [...code.matchAll(/"((?:[^"\\]|\\.)*)"/gs)]
  .map(([, literal]) => literal.replace(/\\\n\s*/g, '').replaceAll('\\"', '"'))
  .filter(literal => /\S \S/.test(literal));

/** The code of a function before a place in it. */
const functionUpTo = (text, index) => text.slice(0, index).split(/\bfn (?=\w+[(<])/).at(-1);

/** The code from the latest `let` that names the variable, up to its use. */
function definitionOf(variable, before) {
  const [latest] = [...before.matchAll(new RegExp(`\\blet [^=;]*\\b${variable}\\b[^=;]* =`, 'g'))].slice(-1);
  return latest ? before.slice(latest.index) : '';
}

/** The variable that a call gets instead of a literal. */
const variableOf = code => code.trim().match(/^(?:CloseCode::\w+,\s*)?([a-z_]+)(?:\.to_owned\(\)|,\s*most\b[^]*)?$/)?.[1];

/** The sentence with `{}` for each variable; once for each of the literals, if a variable has only literals. */
function withInserts(sentence, before) {
  const [insert, variable] = sentence.match(/\{(\w*)[^}]*\}/) ?? [];
  if (insert === undefined) return [sentence];
  const [from, to] = [sentence.slice(0, sentence.indexOf(insert)), sentence.slice(sentence.indexOf(insert) + insert.length)];
  const [definition] = variable ? definitionOf(variable, before).split(';\n') : [''];
  const literals = definition.startsWith(`let ${variable} =`) ? sentencesIn(definition) : [];
  return withInserts(to, before).flatMap(rest => (literals.length ? literals : ['{}']).map(literal => `${from}${literal}${rest}`));
}

const asShown = sentence => sentence[0].toUpperCase() + sentence.slice(1).replace(/\.$/, '') + '.';

/**
 * All sentences of the sources, each once, and the calls whose sentence is in another place. `sources` are names and texts
 * of files.
 */
export function conflictSentences(sources) {
  const [sentences, unread] = [new Set(), new Set()];
  for (const [name, text] of sources) {
    for (const { of, isWhole, only } of CALLS)
      for (const { 0: call, index } of only && only !== name ? [] : text.matchAll(of)) {
        const code = inside(text, index + call.length);
        const after = text.slice(index + call.length + code.length + 1);
        if (/^_$|\.\./.test(code) || /^ =>/.test(after)) continue; // A pattern of a match.
        const [before, variable] = [functionUpTo(text, index), variableOf(code)];
        const found = sentencesIn(variable ? definitionOf(variable, before) : code);
        if (!found.length) unread.add(`${name}: ${code.trim()}`);
        for (const one of found.flatMap(sentence => withInserts(sentence, before))) sentences.add(isWhole ? one : asShown(one));
      }
    for (const [, what, by] of text.matchAll(/\bin_use\(\s*"([^"]+)",\s*"([^"]+)",?\s*\)/g))
      if (!text.includes('fn in_use(')) sentences.add(`${asShown(`${what} is still used by ${by}`)} Delete what refers to it first.`);
  }
  return { sentences: [...sentences], unread: [...unread] };
}

/** The refusals of a box's agent as `[kind, sentence]`. */
export function boxRefusals(source) {
  const kinds = Object.fromEntries([...source.matchAll(/^            Self::(\w+)(?:\(_\))? => "([a-z-]+)",$/gm)].map(([, variant, kind]) => [variant, kind]));
  return [...source.matchAll(/#\[error\("([^"]+)"\)\]\s+(\w+)/g)].map(([, sentence, variant]) => [kinds[variant], sentence.replace(/\{\w*\}/g, '{}')]);
}
