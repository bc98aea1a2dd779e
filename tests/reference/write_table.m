function write_table(path, names, values)
% WRITE_TABLE  A CSV file with one header line; 17 significant digits, so that every bit is kept.
  fid = fopen(path, 'w');
  fprintf(fid, '%s\n', strjoin(names, ','));
  fprintf(fid, [repmat('%.17g,', 1, numel(names) - 1) '%.17g\n'], values');
  fclose(fid);
end
