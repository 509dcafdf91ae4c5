"""What the commands do, one function each; `fe_squeal.cli` lists them and turns errors into exit codes.

A function's signature is the command line, its first sentence the help. Each imports what it needs when it is called,
so that `fe-squeal --help` is there at once and `check` loads no Matplotlib.
"""
