// Runs the extension with the part of VS Code's interface that it uses: node vscode.js EXTENSION
// COMMAND..., a line of JSON for each answer.
const Module = require("module"), path = require("path");
const [, , extension, ...command] = process.argv;

const providers = {}, listeners = {}, shown = {}, errors = [];
let published = () => {};
class Position { constructor(line, character) { Object.assign(this, {line, character}); } }
class Range { constructor(start, end) { Object.assign(this, {start, end}); } }
class Pair { constructor(first, second, third) { Object.assign(this, {first, second, third}); } }
class Edits { constructor() { this.all = []; } set(uri, edits) { this.all.push([`${uri}`, edits]); } }
class DocumentSymbol {
  constructor(name, detail, kind, whole, word) { Object.assign(this, {name, kind, whole, word}); }
}
const register = name => (selector, provider) => { providers[name] = provider; return {}; };
const listen = name => act => { listeners[name] = act; return {}; };
const text = "sequence { PatrolWaypont }\nsubtree go = SeekCharger\n";
const good = "subtree go = SeekCharger\nsequence { use go PatrolWaypoint }\n";
const document = {
  uri: {toString: () => "file:///a%20tree.bt"}, languageId: "islandgp-bt", version: 1,
  text, getText() { return this.text; },
};
const vscode = {
  Position, Range, Location: Pair, TextEdit: Pair, Diagnostic: Pair, CompletionItem: Pair, Hover: Pair,
  CodeAction: Pair, WorkspaceEdit: Edits, DocumentSymbol,
  MarkdownString: class { constructor(value) { this.value = value; } },
  CodeActionKind: {QuickFix: "quickfix"},
  Uri: {parse: value => value},
  languages: {
    createDiagnosticCollection: () => ({set: (uri, found) => { shown[uri] = found; published(); }}),
    ...Object.fromEntries(["CompletionItem", "Hover", "Definition", "Reference", "DocumentSymbol",
      "CodeActions", "DocumentFormattingEdit", "Rename"].map(each => {
      const name = `register${each}Provider`;
      return [name, register(name)];
    })),
  },
  workspace: {
    textDocuments: [document], workspaceFolders: undefined,
    getConfiguration: () => ({get: () => command}),
    onDidOpenTextDocument: listen("open"), onDidChangeTextDocument: listen("change"),
    onDidSaveTextDocument: listen("save"), onDidCloseTextDocument: listen("close"),
  },
  window: {showErrorMessage: message => errors.push(message)},
};
const load = Module._load;
Module._load = (name, ...more) => name === "vscode" ? vscode : load(name, ...more);

const told = (what, value) => console.log(JSON.stringify([what, value]));
const diagnostics = () => new Promise(resolve => { published = resolve; })
  .then(() => shown["file:///a%20tree.bt"]);

(async () => {
  const {activate, deactivate} = require(path.resolve(extension, "extension.js"));
  const context = {subscriptions: []};
  const first = diagnostics();
  await activate(context);
  if (errors.length) return told("error", errors);
  told("diagnostics", (await first).map(each => each.second));
  const ask = (name, method, ...more) => providers[`register${name}Provider`][method](document, ...more);
  const wrong = shown["file:///a%20tree.bt"][0].first;
  told("actions", (await ask("CodeActions", "provideCodeActions", wrong)).map(each => each.first));
  const next = diagnostics();
  Object.assign(document, {text: good, version: 2});
  listeners.change({document});
  told("diagnostics", await next);
  const use = new Position(1, 16), options = {tabSize: 2, insertSpaces: true};
  told("definition", (await ask("Definition", "provideDefinition", use)).second.start);
  told("references", (await ask("Reference", "provideReferences", use, {includeDeclaration: true})).length);
  told("symbols", (await ask("DocumentSymbol", "provideDocumentSymbols")).map(each => [each.name, each.kind]));
  told("hover", (await ask("Hover", "provideHover", new Position(0, 15))).first.value);
  told("completion", (await ask("CompletionItem", "provideCompletionItems", use)).map(each => each.first));
  told("prepare", (await ask("Rename", "prepareRename", use)).start);
  told("rename", (await ask("Rename", "provideRenameEdits", use, "run")).all[0][1].length);
  await ask("Rename", "provideRenameEdits", use, "when").catch(error => told("refused", error.message));
  told("format", (await ask("DocumentFormattingEdit", "provideDocumentFormattingEdits", options))[0].second);
  context.subscriptions.forEach(each => each.dispose && each.dispose());
  await deactivate();
  told("errors", errors);
})();
