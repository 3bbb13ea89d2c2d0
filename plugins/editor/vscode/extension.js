// VS Code's side of `islandgp language-server`.
"use strict";
const vscode = require("vscode");
const {Connection} = require("./connection");

const LANGUAGE = "islandgp-bt";
let connection;

// From the protocol's values to VS Code's. Both count lines and UTF-16 units from 0; kinds and
// severities of the protocol are higher by 1.
const place = at => new vscode.Position(at.line, at.character);
const range = ({start, end}) => new vscode.Range(place(start), place(end));
const location = each => new vscode.Location(vscode.Uri.parse(each.uri), range(each.range));
const textEdit = each => new vscode.TextEdit(range(each.range), each.newText);

function diagnostic(each) {
  const made = new vscode.Diagnostic(range(each.range), each.message, each.severity - 1);
  return Object.assign(made, {code: each.code, source: each.source});
}

function workspaceEdit({changes}) {
  const made = new vscode.WorkspaceEdit();
  for (const [uri, edits] of Object.entries(changes)) {
    made.set(vscode.Uri.parse(uri), edits.map(textEdit));
  }
  return made;
}

function codeAction(each) {
  const made = new vscode.CodeAction(each.title, vscode.CodeActionKind.QuickFix);
  return Object.assign(made, {edit: workspaceEdit(each.edit), isPreferred: each.isPreferred});
}

function completion(each) {
  const made = new vscode.CompletionItem(each.label, each.kind - 1);
  return Object.assign(made, {detail: each.detail});
}

function symbol(each) {
  const places = [range(each.range), range(each.selectionRange)];
  return new vscode.DocumentSymbol(each.name, "", each.kind - 1, ...places);
}

const identity = document => ({textDocument: {uri: document.uri.toString()}});
const at = (document, {line, character}) => ({...identity(document), position: {line, character}});
const ask = (what, params) => connection.request(`textDocument/${what}`, params);
const list = (found, make) => (found || []).map(make);

// A method of each provider, by the function of vscode.languages that takes it.
const PROVIDERS = {
  registerCompletionItemProvider: {
    provideCompletionItems: async (document, position) =>
      list(await ask("completion", at(document, position)), completion),
  },
  registerHoverProvider: {
    provideHover: async (document, position) => {
      const found = await ask("hover", at(document, position));
      const text = found && new vscode.MarkdownString(found.contents.value);
      return text && new vscode.Hover(text, range(found.range));
    },
  },
  registerDefinitionProvider: {
    provideDefinition: async (document, position) => {
      const found = await ask("definition", at(document, position));
      return found && location(found);
    },
  },
  registerReferenceProvider: {
    provideReferences: async (document, position, context) =>
      list(await ask("references", {...at(document, position), context}), location),
  },
  registerDocumentSymbolProvider: {
    provideDocumentSymbols: async document =>
      list(await ask("documentSymbol", identity(document)), symbol),
  },
  registerCodeActionsProvider: {
    provideCodeActions: async (document, {start, end}) => {
      const part = {start: at(document, start).position, end: at(document, end).position};
      const params = {...identity(document), range: part, context: {diagnostics: []}};
      return list(await ask("codeAction", params), codeAction);
    },
  },
  registerDocumentFormattingEditProvider: {
    provideDocumentFormattingEdits: async (document, options) =>
      list(await ask("formatting", {...identity(document), options}), textEdit),
  },
  registerRenameProvider: {
    prepareRename: async (document, position) => {
      const found = await ask("prepareRename", at(document, position));
      if (!found) throw new Error("Expected the name of a subtree, a constant or a parameter.");
      return range(found);
    },
    provideRenameEdits: async (document, position, newName) =>
      workspaceEdit(await ask("rename", {...at(document, position), newName})),
  },
};

async function activate(context) {
  const found = vscode.languages.createDiagnosticCollection("islandgp");
  const [folder] = vscode.workspace.workspaceFolders || [];
  const command = vscode.workspace.getConfiguration("islandgp").get("command");
  connection = new Connection(command, folder && folder.uri.fsPath, (method, params) => {
    if (method === "textDocument/publishDiagnostics") {
      found.set(vscode.Uri.parse(params.uri), params.diagnostics.map(diagnostic));
    }
  }, why => {
    if (!context.stopped) {
      vscode.window.showErrorMessage(`islandgp: ${command.join(" ")} ended: ${why}`);
    }
  });
  const about = {processId: process.pid, rootUri: null, capabilities: {}};
  if (!await connection.request("initialize", about).catch(() => null)) return;  // it has ended
  connection.notify("initialized", {});

  const onTrees = act => event => {
    const document = event.document || event;
    if (document.languageId === LANGUAGE) act(document);
  };
  const notify = (what, document, more) =>
    connection.notify(`textDocument/${what}`, {...identity(document), ...more});
  const opened = onTrees(document => {
    const {uri, languageId, version} = document;
    const textDocument = {uri: uri.toString(), languageId, version, text: document.getText()};
    connection.notify("textDocument/didOpen", {textDocument});
  });
  const changed = onTrees(document => notify("didChange", document, {
    textDocument: {...identity(document).textDocument, version: document.version},
    contentChanges: [{text: document.getText()}],
  }));
  context.subscriptions.push(
    found,
    vscode.workspace.onDidOpenTextDocument(opened),
    vscode.workspace.onDidChangeTextDocument(changed),
    vscode.workspace.onDidSaveTextDocument(onTrees(document => notify("didSave", document))),
    vscode.workspace.onDidCloseTextDocument(onTrees(document => notify("didClose", document))),
    {dispose: () => { context.stopped = true; }},
    ...Object.entries(PROVIDERS).map(([register, provider]) =>
      vscode.languages[register]({language: LANGUAGE}, provider)),
  );
  vscode.workspace.textDocuments.forEach(opened);
}

module.exports = {activate, deactivate: () => connection && connection.stop()};
