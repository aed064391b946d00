"""Access to the machine: compiled loops, threads, processes, memory, files and the terminal.

- Loops over pixels and edges: `compiled`, with `kept_code` on disk. Their lists and sets: `linked_lists`, `union_find`.
- Threads: `side_by_side`, `one_ahead`, `torch_threads`. Processes: `workers`, `processors`, `one_process_at_a_time`.
- `reused_memory`, `atomic_file`, `progress_bar`; `availability`, the error for resources that a machine lacks.
"""
