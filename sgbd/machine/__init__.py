"""What the package asks of the machine: compiled loops, threads, processes, memory and files."""
