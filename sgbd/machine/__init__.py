"""What the package asks of the machine: compiled loops, threads, processes, memory, files and a terminal."""
