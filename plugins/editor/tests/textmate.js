// The scopes that VS Code's own engine finds: node textmate.js GRAMMAR FILE..., a line of JSON for
// each token with its text and its innermost scope.
const fs = require("fs"), textmate = require("vscode-textmate"), oniguruma = require("vscode-oniguruma");
const [, , grammar, ...files] = process.argv;
const wasm = fs.readFileSync(require.resolve("vscode-oniguruma/release/onig.wasm")).buffer;
const onigLib = oniguruma.loadWASM(wasm).then(() => ({
  createOnigScanner: patterns => new oniguruma.OnigScanner(patterns),
  createOnigString: text => new oniguruma.OnigString(text),
}));
const loadGrammar = async () => textmate.parseRawGrammar(fs.readFileSync(grammar, "utf8"), grammar);
new textmate.Registry({onigLib, loadGrammar}).loadGrammar("source.islandgp-bt").then(found => {
  for (const file of files) {
    let state = textmate.INITIAL;
    for (const line of fs.readFileSync(file, "utf8").split("\n")) {
      const {tokens, ruleStack} = found.tokenizeLine(line, state);
      state = ruleStack;
      for (const {startIndex, endIndex, scopes} of tokens) {
        console.log(JSON.stringify([line.slice(startIndex, endIndex), scopes[scopes.length - 1]]));
      }
    }
  }
});
