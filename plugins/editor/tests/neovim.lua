-- What a headless Neovim gets from the language server about `my tree.bt`, into out.txt.
local place = vim.fn.getcwd()
local client = vim.lsp.start_client({cmd = {vim.env.TRY_PYTHON, '-c', vim.env.TRY_CODE, 'language-server'}, root_dir = place})
local out = {}
local function note(what, found) table.insert(out, what .. ' ' .. vim.fn.json_encode(found)) end
vim.cmd('edit my\\ tree.bt')
vim.lsp.buf_attach_client(0, client)
vim.wait(20000, function() return #vim.diagnostic.get(0) > 0 end, 20)
for _, d in ipairs(vim.diagnostic.get(0)) do note('diagnostic', {d.lnum, d.col, d.code, d.message}) end
local function ask(method, more)
  local at = {textDocument = {uri = vim.uri_from_bufnr(0)}, position = {line = 1, character = 5}}
  for key, value in pairs(more or {}) do at[key] = value end
  local found = vim.lsp.buf_request_sync(0, 'textDocument/' .. method, at, 20000)
  return found[client].result
end
for _, item in ipairs(ask('completion')) do note('completion', {item.label, item.detail}) end
vim.api.nvim_buf_set_lines(0, 0, -1, false, {'subtree go = SeekCharger', 'sequence { use go PatrolWaypoint }'})
vim.wait(20000, function() return #vim.diagnostic.get(0) == 0 end, 20)
note('left', #vim.diagnostic.get(0))
note('hover', ask('hover', {position = {line = 0, character = 14}}).contents.value)
vim.lsp.util.apply_workspace_edit(ask('rename', {position = {line = 0, character = 9}, newName = 'run'}), 'utf-16')
note('renamed', vim.api.nvim_buf_get_lines(0, 0, -1, false))
if vim.lsp.buf.format then
  vim.lsp.buf.format({timeout_ms = 20000})
else -- before 0.8
  vim.lsp.buf.formatting_sync({}, 20000)
end
note('formatted', vim.api.nvim_buf_get_lines(0, 0, -1, false))
vim.fn.writefile(out, 'out.txt')
vim.cmd('qall!')
