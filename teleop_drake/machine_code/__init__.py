"""Functions of numbers and arrays as machine code, by LLVM (the extra `fast`)."""
